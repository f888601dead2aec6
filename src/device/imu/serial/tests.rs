use super::*;
use crate::clock::MonotonicClock;
use crate::imu::wire::tests::made::{KINDS, RATE_HZ, description, frame};
use crate::model::imu::FusedBy;
use crate::open::{ImuOptions, open_imu};
use std::io::Write;

/// A pseudo-terminal: what is written to the first comes out of the path.
pub(crate) fn pair() -> (TTYPort, String) {
    let (master, slave) = TTYPort::pair().unwrap();
    let path = slave.name().unwrap();
    (master, path)
}

fn open(path: &str, kind: &str, clock: &Arc<dyn Clock>) -> Result<Box<dyn ImuSource>, DeviceError> {
    let options = ImuOptions { description: description(), ..ImuOptions::default() };
    open_imu(&format!("serial:{path},protocol={kind},rate={RATE_HZ}"), Arc::clone(clock), options)
}

fn refusal(result: Result<Box<dyn ImuSource>, DeviceError>) -> DeviceError {
    result.err().unwrap()
}

#[test]
fn every_protocol_comes_through_a_terminal() {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::new());
    for kind in KINDS {
        let (mut master, path) = pair();
        let mut imu = open(&path, kind, &clock).unwrap();
        let mut count = 0;
        for k in 0..40 {
            master.write_all(&frame(kind, k, 1)).unwrap();
            while let Ok(sample) = imu.next(clock.now().plus_seconds(0.004)) {
                assert!(sample.gyro_rad_s.iter().chain(&sample.accel_m_s2).all(|x| x.is_finite()));
                count += 1;
            }
        }
        assert!(count >= 30, "{kind}: {count}");
        let fused_by = if kind == "described" { FusedBy::Host } else { FusedBy::Sensor };
        assert_eq!(imu.orientation().unwrap().fused_by, fused_by, "{kind}");
    }
}

#[test]
fn a_deadline_is_kept_whether_bytes_come_or_not() {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::new());
    let (mut master, path) = pair();
    let mut imu = open(&path, "rvc", &clock).unwrap();
    for garbage in [0, 200] {
        for _ in 0..10 {
            let _ = master.write_all(&vec![0x11; garbage]);
            let deadline = clock.now().plus_seconds(0.01);
            assert_eq!(imu.next(deadline).err().unwrap().kind, ErrorKind::Again);
            // A loaded machine may be late by itself.
            assert!(clock.now().seconds_since(deadline) < 0.5);
        }
    }
    let passed = clock.now();
    assert_eq!(imu.next(passed).err().unwrap().kind, ErrorKind::Again);
}

#[test]
fn a_hang_up_is_reopen_and_the_port_comes_back() {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::new());
    let link = std::env::temp_dir().join(format!("halflight-port-{}", std::process::id()));
    let name = link.to_string_lossy().into_owned();
    for _ in 0..3 {
        assert_eq!(refusal(open(&name, "rvc", &clock)).kind, ErrorKind::Reopen, "it is not there yet");
        let (mut master, path) = pair();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let mut imu = open(&name, "rvc", &clock).unwrap();
        for k in 0..10 {
            master.write_all(&frame("rvc", k, 1)).unwrap();
        }
        assert!(imu.next(clock.now().plus_seconds(2.0)).is_ok());
        drop(master);
        let error = loop {
            match imu.next(clock.now().plus_seconds(0.5)) {
                Ok(_) => {}
                Err(error) => break error,
            }
        };
        assert_eq!(error.kind, ErrorKind::Reopen, "{error}");
        assert!(error.to_string().contains(&name), "{error}");
        std::fs::remove_file(&link).unwrap();
    }
}

/// A clock that is far ahead after each look at it, so that nobody waits for a silence.
struct FastClock(MonotonicClock);

impl Clock for FastClock {
    fn now(&self) -> Timestamp {
        Timestamp(self.0.now().0.saturating_mul(100))
    }

    fn wait_or(&self, _t: Timestamp, signal: &crate::clock::Signal) -> bool {
        signal.is_raised()
    }
}

#[test]
fn a_port_that_says_nothing_or_nonsense_is_told() {
    for (bytes, said) in [(&[][..], "a modem says nothing"), (&[0x42; 64][..], "another baud rate")] {
        let clock: Arc<dyn Clock> = Arc::new(FastClock(MonotonicClock::new()));
        let (mut master, path) = pair();
        let mut imu = open(&path, "rvc", &clock).unwrap();
        let error = loop {
            master.write_all(bytes).unwrap();
            match imu.next(clock.now().plus_seconds(0.5)) {
                Err(error) if error.kind == ErrorKind::Again => {}
                other => break other.err().unwrap(),
            }
        };
        assert_eq!(error.kind, ErrorKind::Reopen);
        assert!(error.to_string().contains(said) && error.to_string().contains(&path), "{error}");
    }
}

#[test]
fn a_path_that_is_no_port_is_told() {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::new());
    let error = refusal(open("/dev/null", "rvc", &clock));
    assert!(error.to_string().contains("serial:/dev/null"), "{error}");
    let error = refusal(open("/dev/null", "rvx", &clock));
    assert!(
        error.kind == ErrorKind::Refused && error.to_string().contains("did you mean \"rvc\"?"),
        "{error}"
    );
}

/// A log that the test reads while the sensor writes it.
#[derive(Clone, Default)]
struct KeptLog(Arc<std::sync::Mutex<Vec<u8>>>);

impl Write for KeptLog {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A source that keeps what it gives, and raises the signal after so many samples.
struct Kept<'a> {
    imu: Box<dyn ImuSource>,
    given: Vec<ImuSample>,
    most: usize,
    stop: &'a crate::clock::Signal,
}

impl ImuSource for Kept<'_> {
    fn next(&mut self, deadline: Timestamp) -> Result<ImuSample, DeviceError> {
        let sample = self.imu.next(deadline)?;
        self.given.push(sample);
        if self.given.len() == self.most {
            self.stop.raise();
        }
        Ok(sample)
    }
}

#[test]
fn a_wire_log_has_every_byte_and_gives_the_same_samples_again() {
    for kind in ["rvc", "described"] {
        let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::new());
        let (mut master, path) = pair();
        let name = format!("serial:{path},protocol={kind},rate={RATE_HZ}");
        let kept = KeptLog::default();
        let raw = Some(WireLogWriter::new(Box::new(kept.clone()), &name).unwrap());
        let options = ImuOptions { description: description(), raw };
        let imu = open_imu(&name, Arc::clone(&clock), options).unwrap();
        let sent: Vec<u8> = (0..40).flat_map(|k| [frame(kind, k, 1), vec![0x11; k % 3]].concat()).collect();
        master.write_all(&sent).unwrap();
        let stop = crate::clock::Signal::default();
        let mut imu = Kept { imu, given: Vec::new(), most: 30, stop: &stop };
        let seen = crate::imu::alone::run(&mut imu, &*clock, &stop, None).unwrap();
        assert!(seen.samples == 30 && seen.span_s > 0.0, "{kind}: {seen:?}");
        // What has not been read yet is read until nothing comes.
        while let Ok(sample) = imu.imu.next(clock.now().plus_seconds(0.2)) {
            imu.given.push(sample);
        }
        let text = String::from_utf8(kept.0.lock().unwrap().clone()).unwrap();
        let reads = crate::imu::wire_log::read(&text).unwrap();
        let logged: Vec<u8> = reads.iter().flat_map(|(_, bytes)| bytes.clone()).collect();
        assert_eq!(logged, sent, "{kind}");
        // The same bytes at the same times, through the same parser and assembler.
        let described = description();
        let mut wire = Wire::new(&described.serial_protocol(Some(kind)).unwrap(), RATE_HZ);
        let mut assembler = Assembler::new(RATE_HZ, described.imu_from_sensor);
        let mut again = Vec::new();
        for (arrival, bytes) in reads {
            wire.feed(&bytes, arrival, |sample| assembler.put(sample));
            while let Some(sample) = assembler.take() {
                again.push(sample);
            }
        }
        assert_eq!(again, imu.given, "{kind}");
    }
}

#[test]
fn a_sensor_by_itself_ends_after_its_seconds_or_when_it_is_gone() {
    let clock: Arc<dyn Clock> = Arc::new(MonotonicClock::new());
    let (mut master, path) = pair();
    let mut imu = open(&path, "rvc", &clock).unwrap();
    let never = crate::clock::Signal::default();
    let seen = crate::imu::alone::run(&mut *imu, &*clock, &never, Some(1e-3)).unwrap();
    assert_eq!(seen.samples, 0);
    drop(imu);
    let mut imu = open(&path, "rvc", &clock).unwrap();
    for k in 0..10 {
        master.write_all(&frame("rvc", k, 1)).unwrap();
    }
    assert!(imu.next(clock.now().plus_seconds(2.0)).is_ok());
    drop(master);
    assert!(crate::imu::alone::run(&mut *imu, &*clock, &never, None).unwrap().samples > 0);
    assert!(crate::imu::alone::run(&mut *imu, &*clock, &never, None).is_err());
}
