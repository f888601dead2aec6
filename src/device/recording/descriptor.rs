//! Protobuf message types described as an MCAP schema record wants them: a `FileDescriptorSet` with all that they import. Pure.

use super::wire::WireWriter;

/// The type of a field, as numbered in `descriptor.proto`.
#[derive(Clone, Copy, Debug)]
pub enum ProtoFieldType {
    /// `double`
    Double,
    /// `repeated double`
    Doubles,
    /// `int32`
    Int32,
    /// `int64`
    Int64,
    /// `fixed32`
    Fixed32,
    /// `string`
    Text,
    /// `bytes`
    Bytes,
    /// The message of another file.
    Message(&'static ProtoFile),
}

/// A `.proto` file with one message type. What its fields are made of is what it imports.
#[derive(Debug)]
pub struct ProtoFile {
    /// Of the message and, with `.proto`, of the file.
    pub path: &'static str,
    /// Of the message.
    pub package: &'static str,
    /// The message's, without the package.
    pub name: &'static str,
    /// Names, numbers and types.
    pub fields: &'static [(&'static str, u32, ProtoFieldType)],
}

impl ProtoFile {
    /// `package.Name`
    pub fn full_name(&self) -> String {
        format!("{}.{}", self.package, self.name)
    }

    /// Files of the messages that its own message holds, each once.
    fn imports(&self) -> Vec<&'static Self> {
        let mut imports: Vec<&Self> = Vec::new();
        for (_, _, kind) in self.fields {
            if let ProtoFieldType::Message(file) = kind
                && !imports.iter().any(|known| known.path == file.path)
            {
                imports.push(file);
            }
        }
        imports
    }

    /// A `FileDescriptorSet`: what is imported stands before what imports it, and each file once.
    pub fn descriptor_set(&'static self) -> Vec<u8> {
        let mut order = Vec::new();
        self.put_in_order(&mut order);
        let mut set = WireWriter::new();
        for file in order {
            set.message(1, |w| file.describe(w));
        }
        set.finish()
    }

    fn put_in_order(&'static self, order: &mut Vec<&'static Self>) {
        if order.iter().any(|known| known.path == self.path) {
            return;
        }
        for import in self.imports() {
            import.put_in_order(order);
        }
        order.push(self);
    }

    /// A `FileDescriptorProto`.
    fn describe(&self, w: &mut WireWriter) {
        w.bytes(1, self.path.as_bytes()).bytes(2, self.package.as_bytes());
        for import in self.imports() {
            w.bytes(3, import.path.as_bytes());
        }
        w.message(4, |w| {
            w.bytes(1, self.name.as_bytes());
            for (name, number, kind) in self.fields {
                w.message(2, |w| describe_field(w, name, *number, *kind));
            }
        });
        w.bytes(12, b"proto3");
    }
}

fn describe_field(w: &mut WireWriter, name: &str, number: u32, kind: ProtoFieldType) {
    const OPTIONAL: u64 = 1;
    const REPEATED: u64 = 3;
    let (label, code) = match kind {
        ProtoFieldType::Double => (OPTIONAL, 1),
        ProtoFieldType::Doubles => (REPEATED, 1),
        ProtoFieldType::Int64 => (OPTIONAL, 3),
        ProtoFieldType::Int32 => (OPTIONAL, 5),
        ProtoFieldType::Fixed32 => (OPTIONAL, 7),
        ProtoFieldType::Text => (OPTIONAL, 9),
        ProtoFieldType::Message(_) => (OPTIONAL, 11),
        ProtoFieldType::Bytes => (OPTIONAL, 12),
    };
    w.bytes(1, name.as_bytes()).varint(3, u64::from(number)).varint(4, label).varint(5, code);
    if let ProtoFieldType::Message(file) = kind {
        // A leading dot: the name is whole.
        w.bytes(6, format!(".{}", file.full_name()).as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::super::wire::{WireField, fields};
    use super::*;

    static INNER: ProtoFile = ProtoFile {
        path: "p/Inner.proto",
        package: "p",
        name: "Inner",
        fields: &[("x", 1, ProtoFieldType::Double)],
    };
    static MIDDLE: ProtoFile = ProtoFile {
        path: "p/Middle.proto",
        package: "p",
        name: "Middle",
        fields: &[("a", 1, ProtoFieldType::Message(&INNER)), ("b", 2, ProtoFieldType::Message(&INNER))],
    };
    static OUTER: ProtoFile = ProtoFile {
        path: "p/Outer.proto",
        package: "p",
        name: "Outer",
        fields: &[
            ("m", 1, ProtoFieldType::Message(&MIDDLE)),
            ("i", 2, ProtoFieldType::Message(&INNER)),
            ("D", 3, ProtoFieldType::Doubles),
        ],
    };

    fn texts(message: &[u8], number: u32) -> Vec<&[u8]> {
        let all = fields(message).map(Option::unwrap).filter(|(n, _)| *n == number);
        all.filter_map(|(_, field)| if let WireField::Bytes(b) = field { Some(b) } else { None }).collect()
    }

    #[test]
    fn imports_stand_first_and_once() {
        let set = OUTER.descriptor_set();
        let files = texts(&set, 1);
        let paths: Vec<&[u8]> = files.iter().flat_map(|file| texts(file, 1)).collect();
        assert_eq!(paths, [&b"p/Inner.proto"[..], b"p/Middle.proto", b"p/Outer.proto"]);
        assert_eq!(texts(files[1], 3), [b"p/Inner.proto"]);
        assert_eq!(texts(files[2], 3), [&b"p/Middle.proto"[..], b"p/Inner.proto"]);
        assert_eq!(texts(files[2], 12), [b"proto3"]);
    }

    #[test]
    fn fields_have_their_types_and_labels() {
        let set = OUTER.descriptor_set();
        let message = texts(texts(&set, 1)[2], 4)[0];
        let described = texts(message, 2);
        assert_eq!(texts(described[0], 6), [b".p.Middle"]);
        let has = |field: &[u8], number, n| fields(field).any(|f| f == Some((number, WireField::Varint(n))));
        assert!(has(described[2], 4, 3) && has(described[2], 5, 1));
        assert!(has(described[0], 4, 1) && has(described[0], 5, 11));
    }
}
