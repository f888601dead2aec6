//! Numbers of an accessor, read with every offset checked.

use super::source::Source;
use crate::error::AssetError;
use gltf::accessor::{Accessor, DataType};

/// Most elements of an accessor.
const MAX_ELEMENTS: usize = 16 << 20;
/// Most bytes of an accessor in memory that has no bytes in the file.
const MAX_ZERO_BYTES: usize = 64 << 20;

/// Elements of an accessor as rows of N floats: integers as they are, or divided by their range where the accessor is
/// normalised. N may exceed the element's own size; the rest is `fill`.
pub fn floats<const N: usize>(
    source: &Source,
    accessor: &Accessor,
    fill: f32,
) -> Result<Vec<[f32; N]>, AssetError> {
    let kind = accessor.data_type();
    let divisor = if accessor.normalized() { range(kind) } else { 1.0 };
    rows::<N, f32>(source, accessor, fill, |bytes| {
        let number = number(bytes, kind);
        // The lowest signed integer is -1, too. What is not a number stays so, for its reader to refuse.
        if divisor == 1.0 { number as f32 } else { ((number / divisor) as f32).max(-1.0) }
    })
}

/// Elements of an accessor as rows of N whole numbers; negative ones and fractions do not occur in the types read.
pub fn integers<const N: usize>(source: &Source, accessor: &Accessor) -> Result<Vec<[u32; N]>, AssetError> {
    let kind = accessor.data_type();
    if !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32) {
        let key = format!("accessors[{}].componentType", accessor.index());
        return Err(AssetError::new(source.file, key).value(format!("{kind:?}")).allowed("unsigned"));
    }
    rows::<N, u32>(source, accessor, 0, |bytes| number(bytes, kind) as u32)
}

fn range(kind: DataType) -> f64 {
    match kind {
        DataType::I8 => 127.0,
        DataType::U8 => 255.0,
        DataType::I16 => 32_767.0,
        DataType::U16 => 65_535.0,
        DataType::U32 | DataType::F32 => 1.0,
    }
}

/// The little-endian number at the front of `bytes`, which hold at least its size.
fn number(bytes: &[u8], kind: DataType) -> f64 {
    match (kind, bytes) {
        (DataType::I8, [a, ..]) => f64::from(*a as i8),
        (DataType::U8, [a, ..]) => f64::from(*a),
        (DataType::I16, [a, b, ..]) => f64::from(i16::from_le_bytes([*a, *b])),
        (DataType::U16, [a, b, ..]) => f64::from(u16::from_le_bytes([*a, *b])),
        (DataType::U32, [a, b, c, d, ..]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
        (DataType::F32, [a, b, c, d, ..]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
        _ => 0.0,
    }
}

fn rows<const N: usize, T: Copy>(
    source: &Source,
    accessor: &Accessor,
    fill: T,
    decode: impl Fn(&[u8]) -> T,
) -> Result<Vec<[T; N]>, AssetError> {
    let wrong = |allowed: &str| {
        AssetError::new(source.file, format!("accessors[{}]", accessor.index())).allowed(allowed)
    };
    let (size, parts) = (accessor.data_type().size(), accessor.dimensions().multiplicity());
    let element = size * parts;
    if parts > N {
        return Err(wrong(&format!("of at most {N} components")));
    }
    if accessor.count() > MAX_ELEMENTS {
        return Err(wrong(&format!("of at most {MAX_ELEMENTS} elements")));
    }
    let memory = accessor.count().saturating_mul(size_of::<[T; N]>());
    if accessor.view().is_none() && memory > MAX_ZERO_BYTES {
        return Err(wrong(&format!("of at most {MAX_ZERO_BYTES} bytes where it has no buffer view")));
    }
    let decode_row = |bytes: &[u8]| {
        let mut row = [fill; N];
        bytes.chunks_exact(size).zip(&mut row).for_each(|(bytes, slot)| *slot = decode(bytes));
        row
    };
    // Elements `stride` apart from an offset on, all within the view.
    let strided = |view: &gltf::buffer::View, offset: usize, count: usize, element: usize| {
        let bytes = source.view(view.index())?;
        let stride = view.stride().unwrap_or(element);
        let last = stride.checked_mul(count.saturating_sub(1)).and_then(|n| n.checked_add(offset));
        let end = last.and_then(|n| n.checked_add(element));
        if stride < element || end.is_none_or(|end| end > bytes.len()) {
            return Err(wrong("within its buffer view"));
        }
        Ok((bytes, stride))
    };
    let mut out = match accessor.view() {
        Some(view) if accessor.count() > 0 => {
            let (bytes, stride) = strided(&view, accessor.offset(), accessor.count(), element)?;
            let at = |i: usize| accessor.offset() + i * stride;
            (0..accessor.count()).map(|i| decode_row(&bytes[at(i)..at(i) + element])).collect()
        }
        Some(_) => Vec::new(),
        // Without a view all elements are zero (and a sparse part may replace some).
        None => vec![decode_row(&vec![0; element]); accessor.count()],
    };
    if let Some(sparse) = accessor.sparse() {
        let (indices, values) = (sparse.indices(), sparse.values());
        let kind = match indices.index_type() {
            gltf::accessor::sparse::IndexType::U8 => DataType::U8,
            gltf::accessor::sparse::IndexType::U16 => DataType::U16,
            gltf::accessor::sparse::IndexType::U32 => DataType::U32,
        };
        if sparse.count() > accessor.count() {
            return Err(wrong("replaced at no more places than it has"));
        }
        if sparse.count() > 0 {
            let (ib, is) = strided(&indices.view(), indices.offset(), sparse.count(), kind.size())?;
            let (vb, vs) = strided(&values.view(), values.offset(), sparse.count(), element)?;
            for k in 0..sparse.count() {
                let index = number(&ib[indices.offset() + k * is..], kind) as usize;
                let from = values.offset() + k * vs;
                let slot = out.get_mut(index).ok_or_else(|| wrong("replaced only at places that it has"))?;
                *slot = decode_row(&vb[from..from + element]);
            }
        }
    }
    Ok(out)
}
