//! Devices by name, from what was compiled in.

use burn::tensor::Device;

/// Why a device cannot be had.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DeviceError {
    /// No such name.
    #[error("unknown device `{found}`; this program has: {}", compiled_in().join(", "))]
    Unknown {
        /// The name given.
        found: String,
    },
    /// Known, but left out of this build.
    #[error(
        "device `{name}` is not in this build (it has: {}); build one that has it with \
         `cargo build --release -p train --features {name}` (likewise infer, evaluate), or use `--device cpu`",
        compiled_in().join(", ")
    )]
    NotCompiledIn {
        /// The device.
        name: &'static str,
    },
    /// The driver or the hardware is missing.
    #[error("device `{name}` does not start: {reason}; install {driver}, or use `--device cpu`")]
    NoDriver {
        /// The device.
        name: &'static str,
        /// What the runtime said.
        reason: String,
        /// What is likely missing.
        driver: &'static str,
    },
    /// It computes, but not in this precision.
    #[error(
        "device `{device}` cannot train in {precision}: {reason}; use `--set precision=f32`, which every device can"
    )]
    Precision {
        /// The device.
        device: String,
        /// What it cannot do.
        precision: &'static str,
        /// Why not.
        reason: String,
    },
    /// The CPU is asked for, but burn would start a GPU all the same.
    #[error(
        "{of}: burn reads a run's moments by way of that device, whatever --device says; set BURN_DEVICE=flex in the environment"
    )]
    Default {
        /// Why the GPU cannot be had.
        of: Box<DeviceError>,
    },
}

/// Every name that [`open`] knows.
pub const NAMES: [&str; 4] = ["cpu", "wgpu", "cuda", "ndarray"];

/// Names of the devices that were compiled in; `cpu` always is.
pub fn compiled_in() -> Vec<&'static str> {
    let mut names = vec!["cpu"];
    if cfg!(feature = "wgpu") {
        names.push("wgpu");
    }
    if cfg!(feature = "cuda") {
        names.push("cuda");
    }
    if cfg!(feature = "ndarray") {
        names.push("ndarray");
    }
    names
}

/// The device of this name: `cpu` (burn-flex), `wgpu` (any Vulkan, Metal or DX12 GPU), `cuda`, or `ndarray` (the
/// deprecated CPU backend, plain layers only). Starts the GPU's driver, so that a missing one is an error here and
/// not a panic at the first tensor.
pub fn open(name: &str) -> Result<Device, DeviceError> {
    match name {
        "cpu" => Ok(Device::flex()),
        #[cfg(feature = "wgpu")]
        "wgpu" => gpu::wgpu(),
        #[cfg(not(feature = "wgpu"))]
        "wgpu" => Err(DeviceError::NotCompiledIn { name: "wgpu" }),
        #[cfg(feature = "cuda")]
        "cuda" => gpu::cuda(),
        #[cfg(not(feature = "cuda"))]
        "cuda" => Err(DeviceError::NotCompiledIn { name: "cuda" }),
        #[cfg(feature = "ndarray")]
        "ndarray" => {
            #[allow(deprecated)] // Kept selectable for comparison; see the workspace's Cargo.toml.
            Ok(Device::ndarray())
        }
        #[cfg(not(feature = "ndarray"))]
        "ndarray" => Err(DeviceError::NotCompiledIn { name: "ndarray" }),
        _ => Err(DeviceError::Unknown { found: name.to_string() }),
    }
}

/// Whether burn's default device starts. An optimizer's moments are read by way of it, and it is a GPU wherever one was
/// compiled in: without its driver burn would panic.
pub fn check_default() -> Result<(), DeviceError> {
    if std::env::var_os("BURN_DEVICE").is_some() {
        return Ok(());
    }
    let gpu = ["cuda", "wgpu"].into_iter().find(|name| compiled_in().contains(name));
    let opened = gpu.map_or(Ok(()), |name| open(name).map(|_| ()));
    opened.map_err(|of| DeviceError::Default { of: Box::new(of) })
}

/// Whether the device computes asynchronously, so that reading a number waits for everything before it.
pub fn works_by_itself(device: &Device) -> bool {
    #[cfg(feature = "ndarray")]
    #[allow(deprecated)]
    if *device == Device::ndarray() {
        return false;
    }
    *device != Device::flex()
}

#[cfg(any(feature = "wgpu", feature = "cuda"))]
mod gpu {
    use super::DeviceError;
    use burn::tensor::{Device, Tensor};
    use std::sync::OnceLock;

    #[cfg(feature = "wgpu")]
    const DRIVER: &str =
        "a Vulkan, Metal or DX12 driver (Debian: libvulkan1, and the card's driver or mesa-vulkan-drivers)";

    #[cfg(feature = "wgpu")]
    pub fn wgpu() -> Result<Device, DeviceError> {
        use burn::tensor::DeviceKind;
        use burn::tensor::wgpu::wgpu::Backend;
        // The runtime can be set up once per process.
        static OPENED: OnceLock<Result<Device, DeviceError>> = OnceLock::new();
        let fail = |reason| DeviceError::NoDriver { name: "wgpu", reason, driver: DRIVER };
        OPENED
            .get_or_init(|| {
                // A machine without a GPU may still have a software driver, which only `Cpu` selects.
                let opened = Device::wgpu_options().device_kind(DeviceKind::DefaultDevice).init_with_setup();
                let (device, setup) = opened.map_err(|e| fail(e.to_string()))?;
                if setup.backend == Backend::Gl {
                    return Err(fail(format!("`{}` is reached through OpenGL only", setup.adapter.get_info().name)));
                }
                probe(&device).map_err(fail)?;
                Ok(device)
            })
            .clone()
    }

    #[cfg(feature = "cuda")]
    pub fn cuda() -> Result<Device, DeviceError> {
        static OPENED: OnceLock<Result<Device, DeviceError>> = OnceLock::new();
        let fail =
            |reason| DeviceError::NoDriver { name: "cuda", reason, driver: "the NVIDIA driver and CUDA toolkit" };
        OPENED
            .get_or_init(|| {
                let device = std::panic::catch_unwind(|| Device::cuda(0)).map_err(|e| fail(panic_text(e.as_ref())))?;
                probe(&device).map_err(fail)?;
                Ok(device)
            })
            .clone()
    }

    /// Computes one number: the runtimes report a missing driver by a panic at the first tensor.
    fn probe(device: &Device) -> Result<(), String> {
        let device = device.clone();
        let sum = std::panic::catch_unwind(move || Tensor::<1>::ones([4], &device).sum().into_scalar::<f32>());
        match sum {
            Ok(4.0) => Ok(()),
            Ok(found) => Err(format!("1 + 1 + 1 + 1 came out as {found}")),
            Err(panic) => Err(panic_text(panic.as_ref())),
        }
    }

    fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
        let text = panic.downcast_ref::<String>().cloned();
        text.or_else(|| panic.downcast_ref::<&str>().map(|s| s.to_string())).unwrap_or_else(|| "it panicked".into())
    }
}

#[cfg(test)]
mod tests;
