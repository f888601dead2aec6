//! A machine made of a folder.

use super::inertial::Gives;
use super::rights::{RULES, RightOf};
use super::*;
use std::os::unix::fs::symlink;

struct FolderTree(PathBuf);

impl FolderTree {
    fn new(name: &str) -> Self {
        let root = std::env::temp_dir().join(format!("halflight-at-hand-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&root);
        fs::create_dir_all(&root).unwrap();
        Self(root)
    }

    fn put(&self, path: &str, bytes: impl AsRef<[u8]>) {
        let file = self.0.join(path);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, bytes).unwrap();
    }

    fn link(&self, at: &str, to: &str) {
        let file = self.0.join(at);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        symlink(to, file).unwrap();
    }

    fn hidraw(&self, node: &str, ids: &str, name: &str, descriptor: &[u8]) {
        let folder = format!("sys/class/hidraw/{node}/device");
        self.put(&format!("{folder}/uevent"), format!("DRIVER=hid-generic\nHID_ID={ids}\nHID_NAME={name}\n"));
        self.put(&format!("{folder}/report_descriptor"), descriptor);
        self.put(&format!("dev/{node}"), "");
    }

    fn iio(&self, folder: &str, name: &str, channels: &[&str]) {
        let at = format!("sys/bus/iio/devices/{folder}");
        self.put(&format!("{at}/name"), format!("{name}\n"));
        self.put(&format!("{at}/sampling_frequency"), "200.000000\n");
        self.put(&format!("{at}/buffer/enable"), "0\n");
        for channel in channels {
            self.put(&format!("{at}/scan_elements/{channel}_type"), "le:s16/16>>0\n");
        }
        self.put(&format!("dev/{folder}"), "");
    }

    fn machine(&self, may_use: fn(&Path) -> bool) -> PluggedMachine {
        PluggedMachine::new(&self.0, may_use)
    }
}

impl Drop for FolderTree {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A vendor's collection with input report `id` of `bytes` bytes after its number.
fn descriptor(id: u8, bytes: u8) -> Vec<u8> {
    vec![
        0x06, 0x00, 0xFF, 0x09, 0x01, 0xA1, 0x01, 0x85, id, 0x75, 0x08, 0x95, bytes, 0x09, 0x02, 0x81, 0x02,
        0xC0,
    ]
}

fn full_tree(name: &str) -> FolderTree {
    let tree = FolderTree::new(name);
    tree.hidraw("hidraw0", "0003:0000046D:0000C31C", "A Keyboard", &descriptor(1, 8));
    // Two interfaces of one headset: the second sends the samples.
    tree.hidraw("hidraw2", "0003:00002833:00000021", "Rift DK2", &descriptor(9, 4));
    tree.hidraw("hidraw10", "0003:00002833:00000021", "Rift DK2", &descriptor(11, 63));
    tree.iio("iio:device0", "als", &["in_illuminance"]);
    tree.iio("iio:device1", "gyro_3d", &["in_anglvel_x"]);
    tree.iio("iio:device2", "accel_3d", &["in_accel_x"]);
    tree.iio("iio:device3", "dev_rotation", &["in_rot_quaternion"]);
    tree
}

#[test]
fn sensors_are_known_without_opening_them_and_the_best_comes_first() {
    let tree = full_tree("sensors");
    let sensors = tree.machine(|_| true).sensors();
    let told: Vec<(&str, Gives)> = sensors.iter().map(|s| (s.name.as_str(), s.gives)).collect();
    let expected = [
        ("hid:2833:0021", Gives::Headset),
        ("iio:name=dev_rotation", Gives::Orientation),
        ("iio:name=gyro_3d", Gives::RatesAndForces),
        ("iio:name=accel_3d", Gives::Part),
    ];
    assert_eq!(told, expected);
    assert_eq!((sensors[0].node.as_str(), sensors[0].product.as_str()), ("/dev/hidraw10", "Rift DK2"));
    assert_eq!((sensors[0].protocol, sensors[0].rate_hz), (Some("rift"), Some(1000.0)));
    assert_eq!(sensors[1].rate_hz, Some(200.0));
    assert!(sensors.iter().all(|s| s.missing.is_none()));
}

#[test]
fn two_devices_of_one_name_are_told_apart_by_their_nodes() {
    let tree = FolderTree::new("twins");
    for folder in ["iio:device0", "iio:device1"] {
        tree.iio(folder, "lsm6", &["in_anglvel_x", "in_accel_x"]);
    }
    let names: Vec<String> = tree.machine(|_| true).sensors().into_iter().map(|s| s.name).collect();
    assert_eq!(names, ["iio:/dev/iio:device0", "iio:/dev/iio:device1"]);
}

#[test]
fn a_missing_right_has_its_command() {
    let tree = full_tree("rights");
    tree.put("dev/video0", "");
    let nothing = tree.machine(|_| false);
    let mend = |machine: &PluggedMachine, path: &str, right| machine.missing(path, right).unwrap().mend;
    assert!(mend(&nothing, "/dev/video0", RightOf::Video).contains("usermod -aG video"));
    let sensors = nothing.sensors();
    let missing = sensors[0].missing.as_ref().unwrap();
    assert_eq!((missing.path.as_path(), missing.group), (Path::new("/dev/hidraw10"), "plugdev"));
    assert!(missing.mend.contains(&format!("cp systemd/{RULES} /etc/udev/rules.d/")), "{}", missing.mend);
    // Where the rules are there it is the group that is missing.
    tree.put(&format!("etc/udev/rules.d/{RULES}"), "");
    let mended = mend(&nothing, "/dev/hidraw10", RightOf::Rules);
    assert!(mended.starts_with("sudo usermod -aG plugdev"), "{mended}");
    // The node alone is not enough: the buffer is set up by a file of sysfs.
    let only_nodes = tree.machine(|path| !path.ends_with("buffer/enable"));
    let missing = only_nodes.sensors()[1].missing.clone().unwrap();
    assert!(missing.path.ends_with("iio:device3/buffer/enable"));
    assert!(nothing.missing("/dev/not-there", RightOf::Video).is_none());
}

#[test]
fn damaged_trees_are_read_as_far_as_they_go() {
    let tree = FolderTree::new("damaged");
    for (node, ids) in [("hidraw0", "x"), ("hidraw1", "0003:FFFFFFFF:0021"), ("hidraw2", "0003:00002833")] {
        tree.hidraw(node, ids, "", &descriptor(11, 63));
    }
    tree.hidraw("hidraw3", "0003:00002833:00000021", "cut", &[0xFF, 0xFE]);
    tree.put("sys/class/hidraw/hidraw4/device/uevent", [0xFF; 9000]);
    tree.put("sys/bus/iio/devices/iio:device0/name", "");
    assert!(tree.machine(|_| true).sensors().is_empty());
    assert!(PluggedMachine::new("/no/such/place", |_| true).sensors().is_empty());
}

#[cfg(feature = "serial")]
#[test]
fn ports_say_who_they_are_and_which_are_modems() {
    use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
    let tree = FolderTree::new("ports");
    let usb = |vid, pid, manufacturer: &str, product: &str| {
        SerialPortType::UsbPort(UsbPortInfo {
            vid,
            pid,
            serial_number: None,
            manufacturer: Some(manufacturer.into()),
            product: Some(product.into()),
        })
    };
    // A chip's port lies in a folder below its interface; a modem of the class CDC has a network beside it.
    for (port, place, driver) in [
        ("ttyUSB10", "1-1/1-1:1.0/ttyUSB10", "cp210x"),
        ("ttyUSB1", "1-2/1-2:1.2/ttyUSB1", "option"),
        ("ttyACM0", "1-3/1-3:1.3", "cdc_acm"),
        ("ttyACM1", "1-4/1-4:1.0", "cdc_acm"),
    ] {
        let interface: PathBuf = PathBuf::from(place).iter().take(2).collect();
        tree.put(&format!("sys/devices/{}/idVendor", &place[..3]), "1234");
        fs::create_dir_all(tree.0.join("sys/devices").join(place)).unwrap();
        let at = format!("sys/devices/{}/driver", interface.display());
        tree.link(&at, &format!("../../../bus/usb/drivers/{driver}"));
        tree.link(&format!("sys/class/tty/{port}/device"), &format!("../../../devices/{place}"));
        tree.put(&format!("dev/{port}"), "");
    }
    tree.link("sys/devices/1-3/1-3:1.0/driver", "../../../bus/usb/drivers/cdc_mbim");
    let port = |name: &str, port_type| SerialPortInfo { port_name: format!("/dev/{name}"), port_type };
    let machine = tree.machine(|path| !path.ends_with("ttyACM1"));
    let listed = machine.ports(vec![
        port("ttyUSB10", usb(0x10C4, 0xEA60, "Silicon Labs", "CP2102")),
        port("ttyUSB1", usb(0x2C7C, 0x0125, "Quectel", "EG25-G")),
        port("ttyACM0", usb(0x1199, 0x9091, "Sierra Wireless", "EM7565")),
        port("ttyACM1", usb(0x0483, 0x5740, "Somebody", "Data Modem")),
        port("ttyS0", SerialPortType::PciPort),
    ]);
    let told: Vec<(&str, Option<&str>)> =
        listed.iter().map(|p| (p.path.as_str(), p.modem.as_deref())).collect();
    let expected = [
        ("/dev/ttyS0", None),
        ("/dev/ttyACM0", Some("its driver is cdc_mbim")),
        ("/dev/ttyACM1", Some("it calls itself so")),
        ("/dev/ttyUSB1", Some("its driver is option")),
        ("/dev/ttyUSB10", None),
    ];
    assert_eq!(told, expected);
    assert_eq!(listed[4].usb.as_ref().unwrap().name, "Silicon Labs CP2102");
    assert_eq!(listed[2].missing.as_ref().unwrap().group, "dialout");
    assert!(listed[0].usb.is_none() && listed[0].missing.is_none());
}
