//! Protobuf messages read by the descriptors that a file carries, and held to them: every field known, of its wire type, once.

use halflight::device::recording::wire::{WireField, fields};
use std::collections::BTreeMap;

struct Field {
    name: String,
    kind: u64,
    is_repeated: bool,
    message: String,
}

/// All message types of a `FileDescriptorSet`, by their full names.
pub struct Types(BTreeMap<String, BTreeMap<u32, Field>>);

/// A decoded value.
#[derive(Debug, PartialEq)]
pub enum Value {
    Whole(u64),
    Double(f64),
    Doubles(Vec<f64>),
    Bytes(Vec<u8>),
    Parts(BTreeMap<String, Value>),
}

impl Value {
    pub fn part(&self, name: &str) -> &Self {
        match self {
            Self::Parts(parts) => &parts[name],
            other => panic!("{name} of {other:?}"),
        }
    }

    pub fn text(&self) -> &str {
        match self {
            Self::Bytes(bytes) => std::str::from_utf8(bytes).unwrap(),
            other => panic!("{other:?}"),
        }
    }

    pub fn whole(&self) -> u64 {
        match self {
            Self::Whole(n) => *n,
            other => panic!("{other:?}"),
        }
    }

    /// Bits of the numbers that a message is made of, by name.
    pub fn doubles(&self) -> BTreeMap<String, u64> {
        let Self::Parts(parts) = self else { panic!("{self:?}") };
        let bits = |value: &Self| match value {
            Self::Double(x) => x.to_bits(),
            other => panic!("{other:?}"),
        };
        parts.iter().map(|(name, value)| (name.clone(), bits(value))).collect()
    }
}

type Found<'a> = Vec<(u32, WireField<'a>)>;

fn all(message: &[u8]) -> Result<Found<'_>, String> {
    fields(message).collect::<Option<_>>().ok_or_else(|| "no valid protobuf".to_owned())
}

fn parts<'a>(found: &Found<'a>, number: u32) -> Vec<&'a [u8]> {
    let bytes = |field: &WireField<'a>| if let WireField::Bytes(bytes) = field { Some(*bytes) } else { None };
    found.iter().filter(|(n, _)| *n == number).filter_map(|(_, field)| bytes(field)).collect()
}

fn text(found: &Found<'_>, number: u32) -> String {
    parts(found, number).last().map(|bytes| String::from_utf8(bytes.to_vec()).unwrap()).unwrap_or_default()
}

fn varint(found: &Found<'_>, number: u32) -> u64 {
    let mut numbers = found.iter().rev().filter(|(n, _)| *n == number);
    numbers.find_map(|(_, f)| if let WireField::Varint(v) = f { Some(*v) } else { None }).unwrap_or(0)
}

impl Types {
    /// Each file may import only files before it, and all that it names must be there.
    pub fn read(set: &[u8]) -> Result<Self, String> {
        let (mut types, mut files) = (BTreeMap::new(), Vec::new());
        for file in parts(&all(set)?, 1) {
            let file = all(file)?;
            for import in parts(&file, 3) {
                let import = String::from_utf8(import.to_vec()).unwrap();
                if !files.contains(&import) {
                    return Err(format!("{import} is imported before it is there"));
                }
            }
            files.push(text(&file, 1));
            for message in parts(&file, 4) {
                let message = all(message)?;
                let mut known = BTreeMap::new();
                for field in parts(&message, 2) {
                    let field = all(field)?;
                    let message = text(&field, 6).trim_start_matches('.').to_owned();
                    let (name, kind) = (text(&field, 1), varint(&field, 5));
                    if kind == 11 && !types.contains_key(&message) {
                        return Err(format!("{name}: no type {message}"));
                    }
                    let described = Field { name, kind, is_repeated: varint(&field, 4) == 3, message };
                    known.insert(varint(&field, 3) as u32, described);
                }
                types.insert(format!("{}.{}", text(&file, 2), text(&message, 1)), known);
            }
        }
        Ok(Self(types))
    }

    /// Fields of each message in one line: `name=number:type`, with a star where there are several.
    pub fn describe(&self) -> BTreeMap<String, String> {
        let line = |fields: &BTreeMap<u32, Field>| {
            let one = |(number, f): (&u32, &Field)| {
                format!("{}={number}:{}{}", f.name, f.kind, if f.is_repeated { "*" } else { "" })
            };
            fields.iter().map(one).collect::<Vec<_>>().join(" ")
        };
        self.0.iter().map(|(name, fields)| (name.clone(), line(fields))).collect()
    }

    /// A message of a type, or what does not fit.
    pub fn decode(&self, name: &str, message: &[u8]) -> Result<Value, String> {
        let known = self.0.get(name).ok_or_else(|| format!("no type {name}"))?;
        let mut parts = BTreeMap::new();
        for (number, found) in all(message)? {
            let field = known.get(&number).ok_or_else(|| format!("{name}: no field {number}"))?;
            let value = match (field.kind, field.is_repeated, found) {
                (1, false, WireField::Fixed64(bits)) => Value::Double(f64::from_bits(bits)),
                (1, true, WireField::Bytes(packed)) if packed.len() % 8 == 0 => {
                    let number = |b: &[u8; 8]| f64::from_le_bytes(*b);
                    Value::Doubles(packed.as_chunks::<8>().0.iter().map(number).collect())
                }
                (3 | 5, false, WireField::Varint(n)) => Value::Whole(n),
                (7, false, WireField::Fixed32(n)) => Value::Whole(u64::from(n)),
                (9 | 12, false, WireField::Bytes(bytes)) => Value::Bytes(bytes.to_vec()),
                (11, false, WireField::Bytes(bytes)) => self.decode(&field.message, bytes)?,
                _ => return Err(format!("{name}.{}: {found:?} is not of type {}", field.name, field.kind)),
            };
            if parts.insert(field.name.clone(), value).is_some() {
                return Err(format!("{name}.{}: stands twice", field.name));
            }
        }
        Ok(Value::Parts(parts))
    }
}
