//! The bytes of a model: container, buffers and pictures.

use crate::{
    error::{AssetError, read_file},
    model::{base64, image::Rgb8Image},
    pictures,
};
use gltf::{Document, json::validation::Checked};
use std::{
    collections::HashMap,
    path::{Component, Path},
    rc::Rc,
};

/// A model's file: its description, buffers and decoded pictures.
pub struct Source<'a> {
    /// Names it in errors.
    pub file: &'a Path,
    /// The description, whose indices were checked.
    pub document: Rc<Document>,
    buffers: Vec<Vec<u8>>,
    pictures: HashMap<usize, Rc<Rgb8Image>>,
}

/// Attributes and animations name only what exists: the crate looks these up without asking, and would panic.
fn named_things_exist(file: &Path, json: &gltf::json::Root) -> Result<(), AssetError> {
    let count = json.accessors.len();
    for (m, mesh) in json.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(index) = primitive.attributes.values().find(|index| index.value() >= count) {
                return Err(AssetError::new(file, format!("meshes[{m}].primitives[{p}].attributes"))
                    .value(index.value())
                    .allowed(format!("an accessor, of which there are {count}")));
            }
        }
    }
    for (a, animation) in json.animations.iter().enumerate() {
        let (nodes, samplers) = (json.nodes.len(), animation.samplers.len());
        let missing = |what: String, index: usize, of: &str, count: usize| {
            let what = format!("animations[{a}].{what}");
            let allowed = format!("{of}, of which there are {count}");
            Err(AssetError::new(file, what).value(index).allowed(allowed))
        };
        for (c, channel) in animation.channels.iter().enumerate() {
            let (sampler, node) = (channel.sampler.value(), channel.target.node.value());
            if sampler >= samplers {
                return missing(format!("channels[{c}].sampler"), sampler, "one of its samplers", samplers);
            }
            if node >= nodes {
                return missing(format!("channels[{c}].target.node"), node, "a node", nodes);
            }
            if matches!(channel.target.path, Checked::Invalid) {
                return Err(AssetError::new(file, format!("animations[{a}].channels[{c}].target.path"))
                    .allowed("translation, rotation, scale or weights"));
            }
        }
        for (s, sampler) in animation.samplers.iter().enumerate() {
            if matches!(sampler.interpolation, Checked::Invalid) {
                return Err(AssetError::new(file, format!("animations[{a}].samplers[{s}].interpolation"))
                    .allowed("LINEAR, STEP or CUBICSPLINE"));
            }
            for (key, index) in [("input", sampler.input.value()), ("output", sampler.output.value())] {
                if index >= count {
                    return missing(format!("samplers[{s}].{key}"), index, "an accessor", count);
                }
            }
        }
    }
    Ok(())
}

impl<'a> Source<'a> {
    /// Splits a .glb or takes a .gltf, checks the description and gathers all buffers.
    pub fn open(file: &'a Path, bytes: &[u8]) -> Result<Self, AssetError> {
        let (json, mut binary) = if bytes.starts_with(b"glTF") { split(file, bytes)? } else { (bytes, None) };
        let unsound = |e: gltf::Error| AssetError::new(file, "glTF description").cause(e);
        let json = gltf::Gltf::from_slice_without_validation(json).map_err(unsound)?.document.into_json();
        named_things_exist(file, &json)?;
        let document = Rc::new(Document::from_json(json).map_err(unsound)?);
        let mut buffers = Vec::new();
        for buffer in &document.as_json().buffers {
            let key = format!("buffers[{}]", buffers.len());
            let bytes = match &buffer.uri {
                Some(uri) => fetch(file, &key, uri)?,
                None => binary.take().map(<[u8]>::to_vec).ok_or_else(|| {
                    AssetError::new(file, format!("{key}.uri")).allowed("given, or the .glb's binary chunk")
                })?,
            };
            if (bytes.len() as u64) < buffer.byte_length.0 {
                return Err(AssetError::new(file, format!("{key}.byteLength"))
                    .value(buffer.byte_length.0)
                    .allowed(format!("at most the {} bytes there are", bytes.len())));
            }
            buffers.push(bytes);
        }
        Ok(Self { file, document, buffers, pictures: HashMap::new() })
    }

    /// Bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<&[u8], AssetError> {
        let wrong =
            || AssetError::new(self.file, format!("bufferViews[{index}]")).allowed("within its buffer");
        let view = self.document.as_json().buffer_views.get(index).ok_or_else(wrong)?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        let end = start.checked_add(view.byte_length.0).ok_or_else(wrong)?;
        let range = usize::try_from(start).ok().zip(usize::try_from(end).ok()).ok_or_else(wrong)?;
        let buffer = self.buffers.get(view.buffer.value()).ok_or_else(wrong)?;
        buffer.get(range.0..range.1).ok_or_else(wrong)
    }

    /// A picture by its index, decoded once.
    pub fn picture(&mut self, index: usize) -> Result<Rc<Rgb8Image>, AssetError> {
        if let Some(known) = self.pictures.get(&index) {
            return Ok(known.clone());
        }
        let key = format!("images[{index}]");
        let document = self.document.clone();
        let image = document.as_json().images.get(index);
        let image = image.ok_or_else(|| AssetError::new(self.file, &*key).allowed("an image of the file"))?;
        let fetched;
        let bytes = match (&image.buffer_view, &image.uri) {
            (Some(view), _) => self.view(view.value())?,
            (None, Some(uri)) => {
                fetched = fetch(self.file, &key, uri)?;
                &fetched
            }
            (None, None) => return Err(AssetError::new(self.file, key).allowed("given by bufferView or uri")),
        };
        let picture = pictures::decode_rgb8(self.file, bytes);
        let picture = Rc::new(picture.map_err(|e| AssetError::new(self.file, key).cause(e))?);
        self.pictures.insert(index, picture.clone());
        Ok(picture)
    }
}

/// JSON and binary chunk of a .glb.
fn split<'b>(file: &Path, bytes: &'b [u8]) -> Result<(&'b [u8], Option<&'b [u8]>), AssetError> {
    let cut = || AssetError::new(file, ".glb container").allowed("as long as its chunks say");
    let word =
        |at: usize| -> Option<u32> { bytes.get(at..)?.first_chunk::<4>().map(|b| u32::from_le_bytes(*b)) };
    let version = word(4).ok_or_else(cut)?;
    if version != 2 {
        return Err(AssetError::new(file, ".glb version").value(version).allowed("2"));
    }
    let chunk = |at: usize, kind: &[u8; 4]| -> Option<&'b [u8]> {
        let length = word(at)? as usize;
        let found = bytes.get(at + 4..)?.first_chunk::<4>()? == kind;
        found.then(|| bytes.get(at + 8..(at + 8).checked_add(length)?))?
    };
    let json = chunk(12, b"JSON").ok_or_else(cut)?;
    let next = 20 + json.len().next_multiple_of(4);
    let binary = chunk(next, b"BIN\0");
    if binary.is_none() && bytes.len() > next {
        return Err(cut());
    }
    Ok((json, binary))
}

/// Bytes of a URI: base64 data, or a file at or below the model's folder.
fn fetch(file: &Path, key: &str, uri: &str) -> Result<Vec<u8>, AssetError> {
    let wrong = |allowed: &str| {
        let start: String = uri.chars().take(40).collect();
        AssetError::new(file, format!("{key}.uri")).value(start).allowed(allowed)
    };
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data.split_once(";base64,").ok_or_else(|| wrong("base64 where it is a data: URI"))?;
        return base64::decode(text).ok_or_else(|| wrong("sound base64"));
    }
    let name = percent_decoded(uri).ok_or_else(|| wrong("sound UTF-8 where % is used"))?;
    let outside = || wrong("data:, or a file in the model's folder or below it");
    let steps = Path::new(&name).components();
    let stays = steps.clone().all(|step| matches!(step, Component::Normal(_) | Component::CurDir));
    if !stays || name.is_empty() || uri.contains("://") {
        return Err(outside());
    }
    let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let path = folder.join(&name);
    let failed = |e: std::io::Error| AssetError::new(file, format!("{key}.uri")).value(uri).cause(e);
    // Links may lead anywhere: what counts is where the file really is.
    let (folder, real) = (folder.canonicalize().map_err(failed)?, path.canonicalize().map_err(failed)?);
    if !real.starts_with(&folder) {
        return Err(outside());
    }
    read_file(&real).map_err(|e| AssetError::new(file, format!("{key}.uri")).value(uri).cause(e))
}

fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        rest = tail;
        if first == b'%' {
            let digits = std::str::from_utf8(tail.get(..2)?).ok()?;
            bytes.push(u8::from_str_radix(digits, 16).ok()?);
            rest = &tail[2..];
        } else {
            bytes.push(first);
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_is_decoded() {
        assert_eq!(percent_decoded("a%20b").unwrap(), "a b");
        assert!(percent_decoded("a%2").is_none() && percent_decoded("%ff").is_none());
    }

    #[test]
    fn a_uri_stays_in_the_models_folder() {
        let root = std::env::temp_dir().join(format!("halflight-uri-{}", std::process::id()));
        let folder = root.join("model");
        std::fs::create_dir_all(folder.join("below")).unwrap();
        std::fs::write(root.join("secret.bin"), b"secret").unwrap();
        std::fs::write(folder.join("near.bin"), b"near").unwrap();
        std::fs::write(folder.join("below/far away.bin"), b"far").unwrap();
        std::os::unix::fs::symlink(root.join("secret.bin"), folder.join("out.bin")).unwrap();
        std::os::unix::fs::symlink(&root, folder.join("up")).unwrap();
        std::os::unix::fs::symlink("near.bin", folder.join("in.bin")).unwrap();
        let model = folder.join("model.gltf");
        let read = |uri: &str| fetch(&model, "buffers[0]", uri).map_err(|e| e.to_string());
        assert_eq!(read("near.bin").unwrap(), b"near");
        assert_eq!(read("./below/far%20away.bin").unwrap(), b"far");
        assert_eq!(read("in.bin").unwrap(), b"near");
        let absolute = root.join("secret.bin").display().to_string();
        for uri in [
            "../secret.bin",
            "below/../../secret.bin",
            "%2e%2e/secret.bin",
            "..%2fsecret.bin",
            "out.bin",
            "up/secret.bin",
            &absolute,
            &format!("%2f{}", &absolute[1..]),
            &format!("file://{absolute}"),
            "",
        ] {
            let error = read(uri).unwrap_err();
            assert!(error.contains("buffers[0].uri") && error.contains("model's folder"), "{uri}: {error}");
        }
        // Nothing of what is not there is told either.
        assert!(read("none.bin").unwrap_err().contains("buffers[0].uri = none.bin"));
        std::fs::remove_dir_all(&root).unwrap();
    }
}
