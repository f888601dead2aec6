//! The engines that hard cases run on.

use crate::{gles, support};
use halflight::engine::{
    Engine,
    cpu::CpuEngine,
    gpu::{Backend, GpuEngine},
};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Software devices share the cores: one at a time is as fast.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

pub fn turn() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The CPU's, with two threads.
pub fn cpu() -> CpuEngine {
    CpuEngine::new(Some(2)).expect("threads")
}

/// Runs on the device of a backend, or says that there is none.
pub fn on(backend: Backend, test: &str, run: impl FnOnce(&mut dyn Engine)) {
    let _turn = turn();
    match GpuEngine::new(Some(backend)) {
        Ok(mut engine) => {
            println!("{}", engine.description());
            run(&mut engine);
        }
        Err(error) => support::skip_gpu(&format!("{test} on {}", backend.name()), &error.to_string()),
    }
}

/// A test on GL once more where Mesa offers OpenGL ES 3.1.
pub fn on_gles_3_1(test: &str) {
    let _turn = turn();
    gles::assert_gles_3_1(&gles::child(test, "3.1"));
}

/// Tests of a module's `all` on the CPU, on Vulkan, on GL and on OpenGL ES 3.1; takes the path of the test on GL.
macro_rules! on_each {
    ($gl:literal) => {
        #[test]
        fn cpu() {
            let _turn = crate::engines::turn();
            all(&mut crate::engines::cpu());
        }

        #[test]
        fn vulkan() {
            crate::engines::on(halflight::engine::gpu::Backend::Vulkan, module_path!(), all);
        }

        #[test]
        fn gl() {
            crate::engines::on(halflight::engine::gpu::Backend::Gl, module_path!(), all);
        }

        #[test]
        fn gles_3_1() {
            crate::engines::on_gles_3_1($gl);
        }
    };
}
pub(crate) use on_each;
