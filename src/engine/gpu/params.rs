//! Structs that the host fills and a shader reads. Each is written once here; `tests/shaders.rs` compares every
//! member's name, offset and size with what naga reads from the WGSL struct of the same name.

/// Where one member lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Member {
    /// Its name.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// Bytes.
    pub size: usize,
}

/// The layout of a struct as Rust lays it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Its name, here and in WGSL.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// In order.
    pub members: &'static [Member],
}

macro_rules! shared_struct {
    ($(#[$doc:meta])* $name:ident { $($(#[$member_doc:meta])* $member:ident: $kind:ty,)* }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $($(#[$member_doc])* pub $member: $kind,)* }

        impl $name {
            /// As Rust lays it out.
            pub const LAYOUT: StructLayout = StructLayout {
                name: stringify!($name),
                size: size_of::<Self>(),
                members: &[$(Member {
                    name: stringify!($member),
                    offset: std::mem::offset_of!($name, $member),
                    size: size_of::<$kind>(),
                },)*],
            };
        }
    };
}

shared_struct! {
    /// `hdr/merge_bracket`.
    MergeParams {
        /// Groups of four pixels.
        quads: u32,
        /// Pictures in the bracket.
        pictures: u32,
        /// 32-bit words from one picture to the next.
        picture_words: u32,
        /// Invocations in one row of the dispatch.
        row: u32,
    }
}

shared_struct! {
    /// `light/project_sh`.
    ProjectParams {
        /// Samples in this part.
        samples: u32,
        /// Order of the light, 1 to 6.
        order: u32,
        /// Rows of partial sums before this part's.
        first_partial: u32,
        /// Rows of partial sums in all.
        partials: u32,
    }
}
