//! What `--version` says, the same of both programs.

/// Version and commit, in one line.
pub const SHORT: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("HALFLIGHT_BUILT_FROM"), ")");

#[cfg(feature = "libcamera")]
macro_rules! cameras {
    () => {
        "v4l2, libcamera, synthetic, replay"
    };
}
#[cfg(not(feature = "libcamera"))]
macro_rules! cameras {
    () => {
        "v4l2, synthetic, replay"
    };
}

/// The same with what is built in.
pub const LONG: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    " (",
    env!("HALFLIGHT_BUILT_FROM"),
    ")\nfeatures: mcap (lz4, zstd), png, jpeg, radiance, gltf, apriltag; the tool reads openexr, too\n",
    "backends: cpu, gpu on vulkan, gpu on gl (3.1 or GLES 3.1)\ncameras: ",
    cameras!()
);
