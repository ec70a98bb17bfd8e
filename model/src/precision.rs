//! In what precision the products of training are taken: as in PyTorch's autocast, both factors are rounded, products are summed in
//! f32, and everything else stays in f32 - weights, moments, statistics, the loss.
//!
//! Rounded are the products of the shared MLP over points, which are all but some thousandths of a step's arithmetic, save those
//! with the coordinates, whose three columns cost nothing and whose rounding would move points by 0.2 %.

use crate::device::DeviceError;
use burn::tensor::Device;
#[cfg(any(feature = "wgpu", feature = "cuda", test))]
use burn::tensor::{DType, Tensor};
use serde::{Deserialize, Serialize};
use std::cell::Cell;

/// Precision of products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 24 bits of mantissa.
    #[default]
    F32,
    /// 11 bits, in NVIDIA's matrix units.
    Tf32,
    /// 8 bits.
    Bf16,
}

impl Precision {
    /// Its name in the settings.
    pub fn name(self) -> &'static str {
        match self {
            Precision::F32 => "f32",
            Precision::Tf32 => "tf32",
            Precision::Bf16 => "bf16",
        }
    }

    /// Whether a device, which [`crate::device::open`] opened by this name, can train in it.
    ///
    /// # Errors
    /// It cannot; why not, and what can be done.
    pub fn check(self, name: &str, device: &Device) -> Result<(), DeviceError> {
        let refuse = |reason: &str| {
            Err(DeviceError::Precision { device: name.into(), precision: self.name(), reason: reason.into() })
        };
        match self {
            Precision::F32 => Ok(()),
            _ if !crate::device::works_by_itself(device) => refuse("products on the CPU are in f32"),
            Precision::Tf32 if name == "cuda" => refuse("burn leaves the choice of tf32 to its autotune"),
            Precision::Tf32 => refuse("Vulkan, Metal and DX12 have no tf32"),
            Precision::Bf16 if multiplies_bf16(device) => Ok(()),
            Precision::Bf16 if name == "wgpu" && !cfg!(feature = "spirv") => refuse(
                "this program hands kernels over as WGSL, which has no bf16 (`cargo build --release -p train \
                 --features spirv` builds one that does not)",
            ),
            Precision::Bf16 => refuse("its driver offers no matrix units for bf16"),
        }
    }

    /// The product of two matrices, in f32.
    #[cfg(any(feature = "wgpu", feature = "cuda", test))]
    pub(crate) fn product<const D: usize>(self, a: Tensor<D>, b: Tensor<D>) -> Tensor<D> {
        self.product_as_is(a, b).cast(DType::F32)
    }

    /// The same in the precision that it comes out in, for those who read it once.
    #[cfg(any(feature = "wgpu", feature = "cuda", test))]
    pub(crate) fn product_as_is<const D: usize>(self, a: Tensor<D>, b: Tensor<D>) -> Tensor<D> {
        match self {
            Precision::F32 | Precision::Tf32 => a.matmul(b),
            // The same numbers from the CPU's f32 products, which are fast where its bf16 ones are not.
            Precision::Bf16 if !crate::device::works_by_itself(&a.device()) => {
                let rounded = |x: Tensor<D>| x.cast(DType::BF16).cast(DType::F32);
                let (a, b) = (rounded(a), rounded(b));
                #[cfg(test)]
                if let Some(product) = halves(&a, &b) {
                    return rounded(product);
                }
                rounded(a.matmul(b))
            }
            Precision::Bf16 => a.cast(DType::BF16).matmul(b.cast(DType::BF16)),
        }
    }

    /// a' b of two tall matrices [rows, K] and [rows, C], in f32. Cut into parts of the rows, since a GPU gives a
    /// multiprocessor a tile of the result, and a result of [256, 512] has eight tiles.
    #[cfg(any(feature = "wgpu", feature = "cuda", test))]
    pub(crate) fn product_over_rows(self, a: Tensor<2>, b: Tensor<2>) -> Tensor<2> {
        const TILE: usize = 128;
        const TILES: usize = 256;
        const LEAST_ROWS: usize = 512;
        let ([rows, k], [_, c]) = (a.dims(), b.dims());
        let wanted = (TILES / (k.div_ceil(TILE) * c.div_ceil(TILE))).clamp(1, (rows / LEAST_ROWS).max(1));
        // All parts alike, so a divisor of the rows.
        let parts = (1..=wanted).rev().find(|parts| rows.is_multiple_of(*parts)).unwrap_or(1);
        if parts == 1 {
            return self.product(a.transpose(), b);
        }
        let cut = |x: Tensor<2>, width| x.reshape([parts, rows / parts, width]);
        self.product(cut(a, k).swap_dims(1, 2), cut(b, c)).sum_dim(0).squeeze_dim(0)
    }
}

thread_local! {
    static CURRENT: Cell<Precision> = const { Cell::new(Precision::F32) };
}

/// Runs a forward pass in a precision, and with it the backward pass of what it records. Concerns this thread only.
pub fn within<R>(precision: Precision, forward: impl FnOnce() -> R) -> R {
    struct Restore(Precision);
    impl Drop for Restore {
        fn drop(&mut self) {
            CURRENT.set(self.0);
        }
    }
    let _restore = Restore(CURRENT.replace(precision));
    forward()
}

/// The precision of the forward pass that this thread is in.
#[cfg(any(feature = "wgpu", feature = "cuda", test))]
pub(crate) fn current() -> Precision {
    CURRENT.get()
}

/// Whether bf16 can be stored and converted, and has matrix units. Vulkan has no other arithmetic in it, and none is needed.
#[cfg(any(feature = "wgpu", feature = "cuda"))]
fn multiplies_bf16(device: &Device) -> bool {
    use burn::backend::{Backend, DTypeUsage, Dispatch};
    Dispatch::dtype_usage(device.as_dispatch(), DType::BF16).is_superset(DTypeUsage::Storage | DTypeUsage::Accelerated)
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
fn multiplies_bf16(_: &Device) -> bool {
    false
}

#[cfg(test)]
thread_local! {
    static HALVES: Cell<bool> = const { Cell::new(false) };
}

/// Sums the CPU's products in bf16 in another order, as another device would.
#[cfg(test)]
pub(crate) fn in_two_halves<R>(forward: impl FnOnce() -> R) -> R {
    HALVES.set(true);
    let out = forward();
    HALVES.set(false);
    out
}

/// The product, summed in two halves where this is asked for.
#[cfg(test)]
fn halves<const D: usize>(a: &Tensor<D>, b: &Tensor<D>) -> Option<Tensor<D>> {
    let columns = a.dims()[D - 1];
    if !HALVES.get() || columns < 2 {
        return None;
    }
    let (half, rest) = (columns / 2, columns - columns / 2);
    let part = |first, count| a.clone().narrow(D - 1, first, count).matmul(b.clone().narrow(D - 2, first, count));
    Some(part(0, half) + part(half, rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::TensorData;

    #[test]
    fn the_cpu_trains_in_f32_alone_and_says_what_to_do() {
        let device = Device::flex();
        assert_eq!(Precision::F32.check("cpu", &device), Ok(()));
        for precision in [Precision::Tf32, Precision::Bf16] {
            let text = precision.check("cpu", &device).unwrap_err().to_string();
            assert!(text.contains(&format!("`cpu` cannot train in {}", precision.name())), "{text}");
            assert!(text.contains("precision=f32"), "{text}");
        }
    }

    #[test]
    fn products_round_their_factors_and_nothing_else_is_left_rounded() {
        let matrix =
            |values: [f32; 4]| Tensor::<2>::from_data(TensorData::new(values.to_vec(), [2, 2]), &Device::flex());
        // 1 + 2^-9 lies between the bf16 numbers 1 and 1 + 2^-7, nearer to 1; 1 + 3 * 2^-8 rounds to 1 + 2^-6, the even one.
        let a = matrix([1.0 + 2f32.powi(-9), 0.0, 0.0, 1.0 + 3.0 * 2f32.powi(-8)]);
        let one = matrix([1.0, 0.0, 0.0, 1.0]);
        let found = Precision::Bf16.product(a.clone(), one.clone());
        assert_eq!(found.dtype(), DType::F32);
        assert_eq!(found.into_data().iter::<f32>().collect::<Vec<_>>(), [1.0, 0.0, 0.0, 1.0 + 2f32.powi(-6)]);
        let exact = Precision::F32.product(a.clone(), one);
        assert_eq!(exact.into_data(), a.into_data());
    }

    #[test]
    fn a_product_over_rows_is_the_same_in_parts() {
        let device = Device::flex();
        let tall = |columns: usize, rows: usize| {
            let values = (0..rows * columns).map(|i| ((i * 37) % 101) as f32 / 101.0 - 0.5).collect::<Vec<_>>();
            Tensor::<2>::from_data(TensorData::new(values, [rows, columns]), &device)
        };
        for rows in [7, 1200, 4096, 4099] {
            let (a, b) = (tall(3, rows), tall(5, rows));
            let whole = a.clone().transpose().matmul(b.clone());
            let apart = (Precision::F32.product_over_rows(a, b) - whole).abs().max().into_scalar::<f32>();
            assert!(apart < 1e-3, "{rows} rows: {apart}");
        }
    }

    #[test]
    fn a_precision_ends_with_its_forward_pass_even_one_that_panics() {
        assert_eq!(current(), Precision::F32);
        within(Precision::Bf16, || {
            assert_eq!(current(), Precision::Bf16);
            within(Precision::F32, || assert_eq!(current(), Precision::F32));
            assert_eq!(current(), Precision::Bf16);
        });
        let panicked = std::panic::catch_unwind(|| within(Precision::Bf16, || panic!("on purpose")));
        assert!(panicked.is_err());
        assert_eq!(current(), Precision::F32);
    }
}
