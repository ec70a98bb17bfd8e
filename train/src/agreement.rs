//! The first step of a run on another device, held against the same step on the CPU: burn has open reports of wrong
//! results of fused and of autotuned kernels, and a run that learns from wrong gradients looks like one that learns badly.

use crate::TrainError;
use crate::config::TrainConfig;
use crate::task::Task;
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::store::ModuleRecord;
use burn::tensor::{Device, Tensor};
use model::Precision;
use model::precision::within;
use model::published::Network;

/// How far a device may be from the CPU, as shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Of the loss.
    pub loss: f64,
    /// Of the gradient's length. Where a maximum over points or a ReLU hangs on the last bits, a device picks another point and
    /// its gradient with it: some thousandths in f32, in sound runs.
    pub gradient: f64,
}

impl Bounds {
    /// For products in this precision on both sides. In bf16 the gradient's is three times what two orders of summing differ by
    /// (`model`'s test `two_orders_of_summing_in_bf16_agree_better_than_bf16_and_f32`): against f32,
    /// sound steps are up to 60 % apart.
    pub fn of(precision: Precision) -> Self {
        match precision {
            Precision::F32 => Self { loss: 1e-3, gradient: 0.05 },
            Precision::Tf32 => Self { loss: 5e-3, gradient: 0.1 },
            Precision::Bf16 => Self { loss: 1e-3, gradient: 0.3 },
        }
    }
}

/// Loss and gradient of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Loss.
    pub loss: f64,
    /// All gradients, one after the other.
    pub gradient: Vec<f32>,
}

/// Computes the step on both devices, without dropout and in the same precision. Returns a sentence on how well they agree; `None` where the batch has
/// no usable sample.
///
/// # Errors
/// They do not agree.
pub fn check<T: Task>(
    task: &T,
    config: &TrainConfig,
    device: &Device,
    net: &T::Net,
    batch: &T::Batch,
) -> Result<Option<String>, TrainError> {
    if T::size(batch).0 == 0 {
        return Ok(None);
    }
    let on = |device: &Device| within(config.precision, || first_step(task, device, net.clone().into_record(), batch));
    let cpu = on(&Device::flex());
    model::free_buffers();
    compare(&config.device, &cpu?, &on(device)?, Bounds::of(config.precision)).map(Some)
}

/// Loss and gradient of a batch under these weights.
///
/// # Errors
/// Weights of another network.
pub fn first_step<T: Task>(
    task: &T,
    device: &Device,
    weights: ModuleRecord,
    batch: &T::Batch,
) -> Result<Found, TrainError> {
    let unfit = |text: String| TrainError::setting("network", "sizes as given", text);
    let net = T::Net::create(&task.network_without_dropout(), device).map_err(|e| unfit(e.to_string()))?;
    let net = net.train().try_load_record(weights).map_err(|e| unfit(e.to_string()))?;
    let loss = task.loss(&net, batch, device); // [1]
    let value = loss.clone().into_scalar::<f32>().into();
    Ok(Found { loss: value, gradient: flat(&net, &GradientsParams::from_grads(loss.backward(), &net)) })
}

fn flat<M: Module>(net: &M, gradients: &GradientsParams) -> Vec<f32> {
    struct Collect<'a>(&'a GradientsParams, Vec<f32>);
    impl ModuleVisitor for Collect<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if let Some(gradient) = self.0.get::<D>(param.id) {
                self.1.extend(gradient.into_data().iter::<f32>());
            }
        }
    }
    let mut collect = Collect(gradients, Vec::new());
    net.visit(&mut collect);
    collect.1
}

/// A sentence on how well a device agrees with the CPU.
///
/// # Errors
/// It does not.
pub fn compare(name: &str, cpu: &Found, device: &Found, bounds: Bounds) -> Result<String, TrainError> {
    let length = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    let pairs = cpu.gradient.iter().zip(&device.gradient).map(|(a, b)| f64::from(a - b));
    let apart = length(&mut { pairs }) / length(&mut cpu.gradient.iter().map(|x| f64::from(*x))).max(f64::MIN_POSITIVE);
    let loss_apart = (cpu.loss - device.loss).abs() / cpu.loss.abs().max(f64::MIN_POSITIVE);
    let found = format!(
        "first step on {name} and on the CPU: loss {:.6} and {:.6}, gradients {:.2} % apart",
        device.loss,
        cpu.loss,
        100.0 * apart
    );
    let same_form = cpu.gradient.len() == device.gradient.len();
    // A first batch that overflows does so anywhere, and the guard of every step will say so.
    let overflow = !cpu.loss.is_finite() || cpu.gradient.iter().any(|x| !x.is_finite());
    if same_form && (overflow || (loss_apart <= bounds.loss && apart <= bounds.gradient)) {
        return Ok(found);
    }
    let Bounds { loss, gradient } = bounds;
    Err(TrainError::Disagrees { device: name.to_owned(), found, loss: 100.0 * loss, gradient: 100.0 * gradient })
}
