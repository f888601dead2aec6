//! Results that take long to compute, and what they are kept under from run to run. The keeper itself, which has files,
//! stands in `assets::kept`.

use serde::{Serialize, de::DeserializeOwned};

/// All that a result was computed from. Equal input and version give an equal result, bit for bit.
pub trait KeptInput {
    /// What it is called: the name of its folder in a cache.
    const KIND: &'static str;
    /// Of the computing: another number where the same input gives another result.
    const VERSION: u32;
    /// What is computed.
    type Output: Serialize + DeserializeOwned;

    /// The input, as far as the result depends on it.
    fn hashed(&self) -> impl Serialize;

    /// Whether an output can be this input's: its lengths and indices fit. What is not accepted is computed anew.
    fn accepts(&self, output: &Self::Output) -> bool;
}

/// Keeps results.
pub trait Keeper {
    /// What was kept for an input, else what `compute` gives, which is kept from now on.
    ///
    /// # Errors
    /// As `compute`.
    fn keep<I: KeptInput, E>(
        &self,
        input: &I,
        compute: impl FnOnce() -> Result<I::Output, E>,
    ) -> Result<I::Output, E>;
}

/// Keeps nothing: everything is computed.
#[derive(Clone, Copy, Debug)]
pub struct KeepsNothing;

impl Keeper for KeepsNothing {
    fn keep<I: KeptInput, E>(
        &self,
        _: &I,
        compute: impl FnOnce() -> Result<I::Output, E>,
    ) -> Result<I::Output, E> {
        compute()
    }
}

/// For `#[serde(with = "as_bytes")]`: a long list of plain numbers as one run of bytes, in the machine's own order.
pub mod as_bytes {
    use bytemuck::{AnyBitPattern, NoUninit};
    use serde::{
        Deserializer, Serializer,
        de::{Error, Visitor},
    };
    use std::{fmt, marker::PhantomData};

    /// Writes the list.
    ///
    /// # Errors
    /// As the serializer.
    pub fn serialize<T: NoUninit, S: Serializer>(list: &[T], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_bytes(bytemuck::cast_slice(list))
    }

    /// Reads it again.
    ///
    /// # Errors
    /// As the deserializer; bytes that are no whole number of items.
    pub fn deserialize<'de, T: AnyBitPattern + NoUninit, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Vec<T>, D::Error> {
        struct Items<T>(PhantomData<T>);

        impl<T: AnyBitPattern + NoUninit> Visitor<'_> for Items<T> {
            type Value = Vec<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "items of {} bytes each", size_of::<T>())
            }

            fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<T>, E> {
                if bytes.len().is_multiple_of(size_of::<T>().max(1)) {
                    Ok(bytemuck::pod_collect_to_vec(bytes))
                } else {
                    Err(E::invalid_length(bytes.len(), &self))
                }
            }
        }

        from.deserialize_bytes(Items(PhantomData))
    }
}
