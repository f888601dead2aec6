//! The guest: QEMU without KVM, its sockets, the folder that it shares, and what its console says.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Result};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use std::{fs, thread};

pub const QEMU: &str = "qemu-system-x86_64";
/// How long QEMU may take to make its sockets. Machines under load are slow.
const MOST_START: Duration = Duration::from_secs(120);
/// AVX is slower than SSE where it is emulated, with the same results.
const PROCESSOR: &str = "max,avx=off,avx2=off,fma=off,f16c=off";
/// Without `no_timer_check` a machine under load panics now and then; drivers' errors would slow the console.
const KERNEL_LINE: &str = "console=ttyS0 quiet loglevel=2 panic=-1 no_timer_check";

/// Doors between the harness and the guest.
#[derive(Clone, Copy)]
pub enum Door {
    /// Questions of the guest's steps: ttyS1.
    Control,
    /// What programs do with a camera's buffers: ttyS2.
    Pacing,
    Camera,
    Serial,
}

impl Door {
    const ALL: [Self; 4] = [Self::Control, Self::Pacing, Self::Camera, Self::Serial];

    fn name(self) -> &'static str {
        match self {
            Self::Control => "control",
            Self::Pacing => "pacing",
            Self::Camera => "camera",
            Self::Serial => "serial",
        }
    }
}

/// A running guest; it ends when this is dropped.
pub struct Guest {
    qemu: Child,
    folder: PathBuf,
}

impl Drop for Guest {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

impl Guest {
    /// Starts the guest of a folder that `make-guest.sh` filled.
    pub fn boot(guest: &Path, share: &Path) -> Result<(Self, ChildStdout)> {
        // Paths of sockets must be short.
        let folder = std::env::temp_dir().join(format!("halflight-vm-{}", std::process::id()));
        fs::create_dir_all(&folder)?;
        let mut command = Command::new(QEMU);
        command.args([
            "-M",
            "q35",
            "-accel",
            "tcg,thread=multi",
            "-cpu",
            PROCESSOR,
            "-smp",
            "2",
            "-m",
            "768",
        ]);
        command.args(["-nodefaults", "-display", "none", "-no-reboot", "-serial", "stdio"]);
        command.arg("-kernel").arg(guest.join("kernel")).arg("-initrd").arg(guest.join("initramfs"));
        command.args(["-append", KERNEL_LINE, "-device", "qemu-xhci,id=usb"]);
        for door in Door::ALL {
            let socket = folder.join(door.name());
            let device = format!("socket,id={},path={},server=on,wait=off", door.name(), socket.display());
            command.args(["-chardev", &device]);
        }
        command.args(["-serial", "chardev:control", "-serial", "chardev:pacing"]);
        command.args(["-device", "usb-redir,chardev=camera,id=redirected"]);
        command.args(["-device", "usb-serial,chardev=serial,id=line"]);
        command.arg("-fsdev").arg(format!("local,id=host,path={},security_model=none", share.display()));
        command.args(["-device", "virtio-9p-pci,fsdev=host,mount_tag=host"]);
        let mut qemu = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn()?;
        let console = qemu.stdout.take().expect("it is piped");
        Ok((Self { qemu, folder }, console))
    }

    /// The socket of a door.
    pub fn socket(&self, door: Door) -> PathBuf {
        self.folder.join(door.name())
    }

    /// Connects to a door, as soon as QEMU has made it.
    pub fn connect(&self, door: Door) -> Result<UnixStream> {
        let started = Instant::now();
        loop {
            match UnixStream::connect(self.socket(door)) {
                Err(_) if started.elapsed() < MOST_START => thread::sleep(Duration::from_millis(20)),
                done => return done,
            }
        }
    }

    /// The number of QEMU's process.
    pub fn process(&self) -> u32 {
        self.qemu.id()
    }
}

/// Lines of the console, without the ends that the kernel's console adds.
pub fn lines(console: ChildStdout) -> impl Iterator<Item = String> {
    BufReader::new(console)
        .split(b'\n')
        .map_while(std::result::Result::ok)
        .map(|line| String::from_utf8_lossy(&line).trim_end().to_owned())
}

/// The libraries that a program needs, as the loader finds them on this machine.
fn libraries(program: &Path) -> Result<Vec<PathBuf>> {
    let told = Command::new("ldd").arg(program).output()?;
    let text = String::from_utf8_lossy(&told.stdout).into_owned();
    Ok(text.split_whitespace().filter(|word| word.starts_with('/')).map(PathBuf::from).collect())
}

/// What the guest is given.
pub struct Given<'a> {
    /// Folder with `run` and `steps/`.
    pub scripts: &'a Path,
    /// Names of the steps that it is to run.
    pub steps: &'a [String],
    pub programs: &'a [PathBuf],
    pub recordings: &'a [PathBuf],
}

/// Fills the shared folder anew: scripts, programs with their libraries, recordings, and an empty folder for results.
pub fn fill(share: &Path, given: &Given<'_>) -> Result<()> {
    if share.exists() {
        fs::remove_dir_all(share)?;
    }
    for folder in ["guest/steps", "bin", "lib", "recordings", "out"] {
        fs::create_dir_all(share.join(folder))?;
    }
    let copy_into = |file: &Path, folder: &str| -> Result<()> {
        let name = file.file_name().unwrap_or(OsStr::new("file"));
        fs::copy(file, share.join(folder).join(name)).map(|_| ())
    };
    for script in ["run", "steps.sh"] {
        copy_into(&given.scripts.join(script), "guest")?;
    }
    for step in given.steps {
        copy_into(&given.scripts.join(format!("steps/{step}.sh")), "guest/steps")?;
    }
    for program in given.programs {
        copy_into(program, "bin")?;
        for library in libraries(program)? {
            copy_into(&library, "lib")?;
        }
    }
    given.recordings.iter().try_for_each(|recording| copy_into(recording, "recordings"))
}
