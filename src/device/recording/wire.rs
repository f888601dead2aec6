//! Protocol Buffers by hand: the few wire forms that Foxglove's messages use. Pure.

/// Appends fields to a message.
#[derive(Clone, Debug, Default)]
pub struct WireWriter(Vec<u8>);

/// The value of one field as it lies in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireField<'a> {
    /// Wire type 0.
    Varint(u64),
    /// Wire type 1.
    Fixed64(u64),
    /// Wire type 2: bytes, text or a message.
    Bytes(&'a [u8]),
    /// Wire type 5.
    Fixed32(u32),
}

impl WireWriter {
    /// An empty message.
    pub fn new() -> Self {
        Self::default()
    }

    fn raw_varint(&mut self, mut n: u64) {
        while n >= 0x80 {
            self.0.push(n as u8 | 0x80);
            n >>= 7;
        }
        self.0.push(n as u8);
    }

    /// A whole number.
    pub fn varint(&mut self, field: u32, n: u64) -> &mut Self {
        self.raw_varint(u64::from(field) << 3);
        self.raw_varint(n);
        self
    }

    /// Bytes, text or a message.
    pub fn bytes(&mut self, field: u32, bytes: &[u8]) -> &mut Self {
        self.raw_varint(u64::from(field) << 3 | 2);
        self.raw_varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
        self
    }

    /// Four bytes.
    pub fn fixed32(&mut self, field: u32, n: u32) -> &mut Self {
        self.raw_varint(u64::from(field) << 3 | 5);
        self.0.extend_from_slice(&n.to_le_bytes());
        self
    }

    /// A number of eight bytes. 0 is written too, so that what is there can be told from what is not.
    pub fn double(&mut self, field: u32, x: f64) -> &mut Self {
        self.raw_varint(u64::from(field) << 3 | 1);
        self.0.extend_from_slice(&x.to_le_bytes());
        self
    }

    /// A list of such numbers, packed.
    pub fn doubles(&mut self, field: u32, list: &[f64]) -> &mut Self {
        self.raw_varint(u64::from(field) << 3 | 2);
        self.raw_varint(8 * list.len() as u64);
        list.iter().for_each(|x| self.0.extend_from_slice(&x.to_le_bytes()));
        self
    }

    /// A message of its own as a field.
    pub fn message(&mut self, field: u32, write: impl FnOnce(&mut Self)) -> &mut Self {
        let mut inner = Self::new();
        write(&mut inner);
        self.bytes(field, &inner.0)
    }

    /// The finished message.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// The fields of a message in their order; `None` once at a place that is no valid field (and then it ends).
pub fn fields(message: &[u8]) -> impl Iterator<Item = Option<(u32, WireField<'_>)>> {
    let mut rest = message;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let field = take_field(&mut rest);
        if field.is_none() {
            rest = &[];
        }
        Some(field)
    })
}

fn take_varint(rest: &mut &[u8]) -> Option<u64> {
    let mut n = 0u64;
    for shift in (0..64).step_by(7) {
        let (&byte, tail) = rest.split_first()?;
        *rest = tail;
        n |= u64::from(byte & 0x7f).checked_shl(shift)?;
        if byte < 0x80 {
            // The tenth byte may only hold the highest bit.
            return (shift < 63 || byte <= 1).then_some(n);
        }
    }
    None
}

fn take<'a>(rest: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (head, tail) = rest.split_at_checked(length)?;
    *rest = tail;
    Some(head)
}

fn take_field<'a>(rest: &mut &'a [u8]) -> Option<(u32, WireField<'a>)> {
    let tag = take_varint(rest)?;
    let field = u32::try_from(tag >> 3).ok().filter(|f| *f > 0)?;
    let content = match tag & 7 {
        0 => WireField::Varint(take_varint(rest)?),
        1 => WireField::Fixed64(u64::from_le_bytes(take(rest, 8)?.try_into().ok()?)),
        2 => {
            let length = usize::try_from(take_varint(rest)?).ok()?;
            WireField::Bytes(take(rest, length)?)
        }
        5 => WireField::Fixed32(u32::from_le_bytes(take(rest, 4)?.try_into().ok()?)),
        _ => return None,
    };
    Some((field, content))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Clone, Debug)]
    enum Owned {
        Varint(u64),
        Bytes(Vec<u8>),
        Fixed32(u32),
        Double(u64),
    }

    fn any_field() -> impl Strategy<Value = (u32, Owned)> {
        let content = prop_oneof![
            any::<u64>().prop_map(Owned::Varint),
            prop::collection::vec(any::<u8>(), 0..40).prop_map(Owned::Bytes),
            any::<u32>().prop_map(Owned::Fixed32),
            any::<u64>().prop_map(Owned::Double),
        ];
        (1u32..(1 << 29), content)
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(list in prop::collection::vec(any_field(), 0..12)) {
            let mut w = WireWriter::new();
            for (field, content) in &list {
                match content {
                    Owned::Varint(n) => w.varint(*field, *n),
                    Owned::Bytes(b) => w.bytes(*field, b),
                    Owned::Fixed32(n) => w.fixed32(*field, *n),
                    Owned::Double(bits) => w.double(*field, f64::from_bits(*bits)),
                };
            }
            let message = w.finish();
            let read: Vec<_> = fields(&message).map(|f| f.unwrap()).collect();
            prop_assert_eq!(read.len(), list.len());
            for ((field, content), (number, got)) in list.iter().zip(read) {
                prop_assert_eq!(*field, number);
                let expected = match content {
                    Owned::Varint(n) => WireField::Varint(*n),
                    Owned::Bytes(b) => WireField::Bytes(b),
                    Owned::Fixed32(n) => WireField::Fixed32(*n),
                    Owned::Double(bits) => WireField::Fixed64(*bits),
                };
                prop_assert_eq!(expected, got);
            }
        }

        #[test]
        fn any_bytes_end_in_fields_or_one_none(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let read: Vec<_> = fields(&bytes).collect();
            prop_assert!(read.iter().rev().skip(1).all(Option::is_some));
        }
    }

    #[test]
    fn known_bytes() {
        // From the encoding guide of Protocol Buffers: field 1 = 150; field 2 = "testing".
        let mut w = WireWriter::new();
        w.varint(1, 150).bytes(2, b"testing");
        let expected = [0x08, 0x96, 0x01, 0x12, 0x07, 0x74, 0x65, 0x73, 0x74, 0x69, 0x6e, 0x67];
        assert_eq!(w.finish(), expected);
        assert_eq!(fields(&[0x08]).collect::<Vec<_>>(), vec![None]);
    }
}
