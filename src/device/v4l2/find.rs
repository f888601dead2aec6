//! From a name to a video node: by its path, by the camera's own name, or the best there is; and to the same camera again when
//! it was pulled out and plugged in elsewhere.

use super::V4l2Options;
use super::format::{self, FormatWish};
use super::node::{EBUSY, ENOTTY, NodeFacts, VideoNode};
use super::sys::KernelNode;
use crate::{DeviceError, ErrorKind};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Nodes that are looked at.
const MOST_NODES: usize = 64;

/// A video node that captures pictures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundNode {
    /// Its node below `/dev`.
    pub path: PathBuf,
    /// Who it is.
    pub facts: NodeFacts,
}

/// What was found of video nodes.
#[derive(Debug, Default)]
pub struct FoundNodes {
    /// Those that capture pictures, by number.
    pub cameras: Vec<FoundNode>,
    /// Those that could not be opened, and why.
    pub refused: Vec<(PathBuf, io::Error)>,
}

/// All video nodes of the machine.
pub fn nodes() -> FoundNodes {
    let mut found = FoundNodes::default();
    for number in 0..MOST_NODES {
        let path = PathBuf::from(format!("/dev/video{number}"));
        if !path.exists() {
            continue;
        }
        match KernelNode::open(&path).and_then(|node| node.facts()) {
            Ok(facts) if facts.captures => found.cameras.push(FoundNode { path, facts }),
            Ok(_) => {}
            Err(error) => found.refused.push((path, error)),
        }
    }
    found
}

/// Who was opened under a name, to be found again: the card and the place that it was plugged into.
static OPENED: Mutex<Vec<(String, NodeFacts)>> = Mutex::new(Vec::new());

/// Opens the node that a name means: a path below `/dev`, `card=TEXT` for a part of the camera's own name, or nothing for
/// the camera with the best offer of pictures. A camera that was opened before by this name is found again at another number, where its path is gone
/// or leads to another camera now.
pub fn open(name: &str, options: &V4l2Options) -> Result<(KernelNode, FoundNode), DeviceError> {
    let (wish, pictures) = (&options.node, &options.wish);
    let device = format!("v4l2:{name}");
    let before = {
        let opened = OPENED.lock().unwrap_or_else(PoisonError::into_inner);
        opened.iter().find(|(known, _)| known == name).map(|(_, facts)| facts.clone())
    };
    let path = match (wish, &before) {
        (NodeWish::Path(path), None) => path.clone(),
        (NodeWish::Path(path), Some(before)) if is_same(path, before) => path.clone(),
        (_, Some(before)) => {
            let cameras = nodes().cameras;
            let same_place = |c: &&FoundNode| c.facts.card == before.card && c.facts.bus == before.bus;
            let again = cameras.iter().find(same_place);
            match again.or_else(|| cameras.iter().find(|c| c.facts.card == before.card)) {
                Some(camera) => camera.path.clone(),
                // Another camera, where the name allows for one.
                None => match wish {
                    NodeWish::Path(path) => path.clone(),
                    NodeWish::Card(_) | NodeWish::Any => named(&device, wish, pictures)?,
                },
            }
        }
        (NodeWish::Card(_) | NodeWish::Any, None) => named(&device, wish, pictures)?,
    };
    let node = KernelNode::open(&path).map_err(|e| refusal(&device, &path, e))?;
    let facts = node.facts().map_err(|e| refusal(&device, &path, e))?;
    if !facts.captures {
        let action = format!(
            "{} gives no pictures: it is for metadata or output; try the node before it",
            path.display()
        );
        return Err(DeviceError::new(&device, action, ErrorKind::Refused));
    }
    let mut opened = OPENED.lock().unwrap_or_else(PoisonError::into_inner);
    opened.retain(|(known, _)| known != name);
    opened.push((name.to_owned(), facts.clone()));
    Ok((node, FoundNode { path, facts }))
}

/// Which node is meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeWish {
    /// This one.
    Path(PathBuf),
    /// The best whose card has this text in its name.
    Card(String),
    /// The best there is.
    Any,
}

fn is_same(path: &Path, before: &NodeFacts) -> bool {
    KernelNode::open(path).and_then(|node| node.facts()).is_ok_and(|now| now.card == before.card)
}

/// Points of a camera's best offer.
fn points(path: &Path, wish: &FormatWish) -> Option<f64> {
    let offers = KernelNode::open(path).and_then(|node| node.offers()).ok()?;
    format::best(&offers, wish).map(|(_, points)| points)
}

fn named(device: &str, wish: &NodeWish, pictures: &FormatWish) -> Result<PathBuf, DeviceError> {
    let found = nodes();
    let is_meant = |camera: &&FoundNode| match wish {
        NodeWish::Card(text) => camera.facts.card.contains(text.as_str()),
        _ => true,
    };
    let mut meant: Vec<(&FoundNode, f64)> =
        found.cameras.iter().filter(is_meant).filter_map(|c| Some((c, points(&c.path, pictures)?))).collect();
    // Of equals the lower number: the sort keeps their order.
    meant.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    if let Some((camera, _)) = meant.first() {
        return Ok(camera.path.clone());
    }
    let there: Vec<String> = found
        .cameras
        .iter()
        .map(|c| format!("{} ({})", c.path.display(), c.facts.card))
        .chain(found.refused.iter().map(|(path, error)| format!("{}: {}", path.display(), why(error))))
        .collect();
    let there = if there.is_empty() { "no /dev/video*".to_owned() } else { there.join(", ") };
    let action = match wish {
        NodeWish::Card(text) => format!("no camera with \"{text}\" in its name; there is {there}"),
        _ => format!("no camera; there is {there}; connect one, or name another source (device.camera)"),
    };
    Err(DeviceError::new(device, action, ErrorKind::Reopen))
}

fn why(error: &io::Error) -> String {
    match error.kind() {
        _ if error.raw_os_error() == Some(ENOTTY) => "it is no video node".to_owned(),
        io::ErrorKind::PermissionDenied => {
            "permission denied; add the user to the group video: usermod -aG video USER".to_owned()
        }
        _ => error.to_string(),
    }
}

/// An error of opening. A camera that is not there, or in somebody's hands, may come: `Reopen`.
pub fn refusal(device: &str, path: &Path, error: io::Error) -> DeviceError {
    let busy = error.raw_os_error() == Some(EBUSY);
    let is_no_video = error.raw_os_error() == Some(ENOTTY);
    let is_for_good =
        is_no_video || matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::InvalidInput);
    let kind = if is_for_good { ErrorKind::Refused } else { ErrorKind::Reopen };
    match holder(path).filter(|_| busy) {
        Some(holder) => {
            let action = format!("open {}: {holder} has it", path.display());
            DeviceError::new(device, action, kind).because(error)
        }
        // The reason stands in the action, where `halflight devices` shows it alone.
        None => DeviceError::new(device, format!("open {}: {}", path.display(), why(&error)), kind),
    }
}

/// Who holds a node open, where /proc tells: its name and process number.
pub fn holder(path: &Path) -> Option<String> {
    let wanted = path.canonicalize().ok()?;
    let own = std::process::id();
    for process in std::fs::read_dir("/proc").ok()?.flatten() {
        let Ok(number) = process.file_name().to_string_lossy().parse::<u32>() else { continue };
        let Ok(open) = std::fs::read_dir(process.path().join("fd")) else { continue };
        let holds = open.flatten().any(|fd| std::fs::read_link(fd.path()).is_ok_and(|to| to == wanted));
        if holds && number != own {
            let name = std::fs::read_to_string(process.path().join("comm")).unwrap_or_default();
            return Some(format!("{} (process {number})", name.trim()));
        }
    }
    None
}
