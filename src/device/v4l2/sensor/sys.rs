//! The kernel's own calls on media controllers and sub-devices. Every call hands the kernel one structure of the size that its
//! number states; layouts are those of `linux/media.h` and `linux/v4l2-subdev.h`.
#![allow(unsafe_code, reason = "the kernel takes pointers")]

use super::{MediaEntity, MediaLink, MediaTopology};
use crate::v4l2::node::{BehindNode, ControlFacts, ControlNode};
use crate::v4l2::sys;
use std::fs::{File, OpenOptions};
use std::io;
use std::mem::zeroed;
use std::os::fd::AsRawFd;
use v4l::v4l2::vidioc;

/// Controllers, entities and links of one that are looked at.
const MOST_CONTROLLERS: u32 = 32;
const MOST_ENTITIES: usize = 256;
const MOST_LINKS: usize = 256;

/// `media_entity_desc`.
#[repr(C)]
#[derive(Clone, Copy)]
struct EntityDesc {
    id: u32,
    name: [u8; 32],
    function: u32,
    revision: u32,
    flags: u32,
    group: u32,
    pads: u16,
    links: u16,
    reserved: [u32; 4],
    major: u32,
    minor: u32,
    rest: [u8; 176],
}

/// `media_pad_desc`.
#[repr(C)]
#[derive(Clone, Copy)]
struct PadDesc {
    entity: u32,
    index: u16,
    flags: u32,
    reserved: [u32; 2],
}

/// `media_link_desc`.
#[repr(C)]
#[derive(Clone, Copy)]
struct LinkDesc {
    source: PadDesc,
    sink: PadDesc,
    flags: u32,
    reserved: [u32; 2],
}

/// `media_links_enum`.
#[repr(C)]
struct LinksEnum {
    entity: u32,
    pads: *mut PadDesc,
    links: *mut LinkDesc,
    reserved: [u32; 4],
}

/// `v4l2_subdev_format`.
#[repr(C)]
struct SubdevFormat {
    which: u32,
    pad: u32,
    width: u32,
    height: u32,
    code: u32,
    field: u32,
    colour_space: u32,
    of_colour: [u16; 14],
    stream: u32,
    reserved: [u32; 7],
}

const fn read_write(letter: u8, number: u8, size: usize) -> vidioc::_IOC_TYPE {
    (3 << 30 | (size as vidioc::_IOC_TYPE) << 16)
        | ((letter as vidioc::_IOC_TYPE) << 8)
        | number as vidioc::_IOC_TYPE
}

const ENUM_ENTITIES: vidioc::_IOC_TYPE = read_write(b'|', 1, size_of::<EntityDesc>());
const ENUM_LINKS: vidioc::_IOC_TYPE = read_write(b'|', 2, size_of::<LinksEnum>());
const SUBDEV_G_FMT: vidioc::_IOC_TYPE = read_write(b'V', 4, size_of::<SubdevFormat>());
/// Flag of an entity's number: the next one after it.
const NEXT: u32 = 1 << 31;
/// `MEDIA_ENT_F_CAM_SENSOR`.
const CAMERA_SENSOR: u32 = 0x0002_0001;
/// `MEDIA_LNK_FL_ENABLED`.
const ENABLED: u32 = 1;
/// `V4L2_SUBDEV_FORMAT_ACTIVE`.
const ACTIVE: u32 = 1;

/// The sensor behind a node, by the kernel's number of that.
pub fn behind(node: u64) -> Option<BehindNode> {
    (0..MOST_CONTROLLERS).find_map(|number| {
        let controller = File::open(format!("/dev/media{number}")).ok()?;
        let topology = topology(&controller).ok()?;
        let sensor = topology.sensor_of(node)?;
        let open = SubDevice::open(sensor.node?).ok()?;
        let size = open.size().ok()?;
        Some(BehindNode { name: sensor.name.clone(), size, controls: Box::new(open) })
    })
}

/// What a controller has.
fn topology(controller: &File) -> io::Result<MediaTopology> {
    let fd = controller.as_raw_fd();
    let mut found = MediaTopology::default();
    let mut last = 0;
    while found.entities.len() < MOST_ENTITIES {
        // SAFETY: plain numbers; zero is a value of each.
        let mut asked: EntityDesc = unsafe { zeroed() };
        asked.id = last | NEXT;
        match sys::call(fd, ENUM_ENTITIES, &mut asked) {
            Ok(()) => {}
            Err(error) if error.raw_os_error() == Some(crate::v4l2::node::EINVAL) => break,
            Err(error) => return Err(error),
        }
        last = asked.id;
        found.links.extend(links(controller, &asked)?);
        found.entities.push(MediaEntity {
            id: asked.id,
            name: sys::text(&asked.name),
            is_sensor: asked.function == CAMERA_SENSOR,
            node: (asked.major != 0).then(|| rustix::fs::makedev(asked.major, asked.minor)),
        });
    }
    Ok(found)
}

/// Links that begin at an entity.
fn links(controller: &File, entity: &EntityDesc) -> io::Result<Vec<MediaLink>> {
    let count = usize::from(entity.links);
    if count == 0 || count > MOST_LINKS {
        return Ok(Vec::new());
    }
    // SAFETY: plain numbers; zero is a value of each.
    let mut all = vec![unsafe { zeroed::<LinkDesc>() }; count];
    let mut asked = LinksEnum {
        entity: entity.id,
        pads: std::ptr::null_mut(),
        links: all.as_mut_ptr(),
        reserved: [0; 4],
    };
    // The kernel writes as many links as the entity said, for which there is room.
    sys::call(controller.as_raw_fd(), ENUM_LINKS, &mut asked)?;
    let link = |link: &LinkDesc| MediaLink {
        from: link.source.entity,
        to: link.sink.entity,
        is_enabled: link.flags & ENABLED != 0,
    };
    Ok(all.iter().map(link).collect())
}

/// A sub-device's node.
struct SubDevice(File);

impl SubDevice {
    /// By the kernel's number; `/sys` knows its name below `/dev`.
    fn open(number: u64) -> io::Result<Self> {
        let (major, minor) = (rustix::fs::major(number), rustix::fs::minor(number));
        let facts = std::fs::read_to_string(format!("/sys/dev/char/{major}:{minor}/uevent"))?;
        let name = facts.lines().find_map(|line| line.strip_prefix("DEVNAME="));
        let name =
            name.filter(|name| !name.contains("..")).ok_or_else(|| io::Error::other("it has no name"))?;
        OpenOptions::new().read(true).write(true).open(format!("/dev/{name}")).map(Self)
    }

    /// Columns and rows of what it gives.
    fn size(&self) -> io::Result<[u32; 2]> {
        // SAFETY: plain numbers; zero is a value of each.
        let mut asked: SubdevFormat = unsafe { zeroed() };
        asked.which = ACTIVE;
        sys::call(self.0.as_raw_fd(), SUBDEV_G_FMT, &mut asked)?;
        Ok([asked.width, asked.height])
    }
}

impl ControlNode for SubDevice {
    fn control_facts(&self, id: u32) -> Option<ControlFacts> {
        sys::control_facts(self.0.as_raw_fd(), id)
    }

    fn control(&self, id: u32) -> io::Result<i32> {
        sys::control(self.0.as_raw_fd(), id)
    }

    fn wide_control(&self, id: u32) -> io::Result<i64> {
        sys::wide_control(self.0.as_raw_fd(), id)
    }

    fn set_control(&self, id: u32, value: i32) -> io::Result<i32> {
        sys::set_control(self.0.as_raw_fd(), id, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_have_the_kernel_s_sizes() {
        assert_eq!(size_of::<EntityDesc>(), 256);
        assert_eq!((size_of::<PadDesc>(), size_of::<LinkDesc>()), (20, 52));
        assert_eq!(size_of::<SubdevFormat>(), 88);
        assert_eq!(ENUM_ENTITIES, 0xc100_7c01);
        #[cfg(target_pointer_width = "64")]
        assert_eq!(ENUM_LINKS, 0xc028_7c02);
        assert_eq!(SUBDEV_G_FMT, 0xc058_5604);
    }
}
