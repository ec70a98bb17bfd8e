//! Reading weights.

use super::{Network, WeightsError};
use burn::module::{ModuleVisitor, Param};
use burn::store::{
    ApplyError, FloatCastAdapter, ModuleAdapter, ModuleContext, ModuleStore, PyTorchToBurnAdapter, PytorchStore,
    bridge, burn_pack::Tensor as Stored,
};
use burn::tensor::{BoolStore, DType, Tensor, TensorData};
use safetensors::{Dtype, SafeTensors};
use std::fmt::Write;
use std::path::Path;

/// All tensors of a `.safetensors` or PyTorch file, by extension. PyTorch files may hold the state dictionary
/// itself or keep it under `state_dict`, `model_state_dict` or `model`; the prefix `module.` of
/// `DataParallel` is dropped.
pub fn read_file(file: &Path) -> Result<Vec<Stored>, WeightsError> {
    let name = format!("{file:?}");
    match file.extension().and_then(|e| e.to_str()) {
        Some("safetensors") => {
            let bytes = std::fs::read(file).map_err(|source| WeightsError::Io { file: name.clone(), cause: source })?;
            read_safetensors(&bytes, &name)
        }
        Some("pth" | "pt" | "bin") => {
            std::fs::File::open(file).map_err(|source| WeightsError::Io { file: name.clone(), cause: source })?;
            read_pytorch(file, &name)
        }
        _ => Err(WeightsError::UnknownKind { file: name }),
    }
}

/// All tensors of a safetensors file in memory; `name` is for messages.
pub fn read_safetensors(bytes: &[u8], name: &str) -> Result<Vec<Stored>, WeightsError> {
    let unreadable = |reason| WeightsError::Unreadable { file: name.to_string(), format: "safetensors", reason };
    let file = SafeTensors::deserialize(bytes).map_err(|e| unreadable(e.to_string()))?;
    let mut tensors = Vec::with_capacity(file.len());
    for (key, view) in file.iter() {
        let dtype = dtype(view.dtype()).ok_or_else(|| {
            unreadable(format!("tensor `{key}` has type {:?}; expected F32, F16, BF16, F64 or integers", view.dtype()))
        })?;
        let data = burn::tensor::Bytes::from_bytes_vec(view.data().to_vec());
        let data = TensorData::try_from_bytes(data, view.shape().to_vec(), dtype)
            .map_err(|e| unreadable(format!("tensor `{key}`: {e}")))?;
        tensors.push(bridge::from_data(data, key.to_string(), None));
    }
    tensors.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(without_prefix(tensors))
}

fn read_pytorch(file: &Path, name: &str) -> Result<Vec<Stored>, WeightsError> {
    let open = |key: Option<&str>| {
        // burn renumbers indices of `Sequential` by default, which would break every published name.
        let store = PytorchStore::from_file(file).map_indices_contiguous(false);
        let mut store = match key {
            Some(key) => store.with_top_level_key(key),
            None => store,
        };
        store.get_all_tensors().map(|tensors| tensors.values().cloned().collect::<Vec<_>>())
    };
    let mut first_error = None;
    for key in [None, Some("state_dict"), Some("model_state_dict"), Some("model")] {
        match open(key) {
            // A file with a nested dictionary reads as names that begin with the dictionary's.
            Ok(tensors) if key.is_none() && tensors.iter().any(|t| is_nested(&t.name)) => {}
            Ok(tensors) if !tensors.is_empty() => return Ok(without_prefix(tensors)),
            Ok(_) => {}
            Err(error) => first_error = first_error.or(Some(error.to_string())),
        }
    }
    let reason = first_error.unwrap_or_else(|| "it holds no tensors".to_string());
    Err(WeightsError::Unreadable { file: name.to_string(), format: "PyTorch", reason })
}

fn is_nested(name: &str) -> bool {
    ["state_dict.", "model_state_dict.", "model."].iter().any(|prefix| name.starts_with(prefix))
}

fn without_prefix(mut tensors: Vec<Stored>) -> Vec<Stored> {
    const PREFIX: &str = "module.";
    if tensors.iter().all(|t| t.name.starts_with(PREFIX)) {
        for tensor in &mut tensors {
            tensor.name.drain(..PREFIX.len());
        }
    }
    tensors
}

/// Puts the tensors into the network, all of them and no other (counters of batches aside). `file` is for
/// messages. On an error the network is lost, since part of it may already be overwritten.
pub fn apply<N: Network>(mut net: N, tensors: Vec<Stored>, file: &str) -> Result<N, WeightsError> {
    let adapter = Squeeze.chain(PyTorchToBurnAdapter).chain(FloatCastAdapter::to(DType::F32));
    let result = net.apply(tensors, None, Some(Box::new(adapter)), false);
    let unused: Vec<_> = result.unused.iter().filter(|name| !name.ends_with(".num_batches_tracked")).collect();
    let mut odd = NotFinite::default();
    net.visit(&mut odd);
    if result.errors.is_empty() && result.missing.is_empty() && unused.is_empty() && odd.names.is_empty() {
        return Ok(net.materialize());
    }
    let mut problems = String::new();
    let mut line = |text: String, shown: &mut usize| {
        *shown += 1;
        if *shown <= SHOWN {
            let _ = write!(problems, "\n  {text}");
        }
    };
    let mut shown = 0;
    for error in &result.errors {
        let text = match error {
            ApplyError::ShapeMismatch { path, expected, found } => format!(
                "misshaped: `{}` is {:?}, expected {:?}",
                published_name(path),
                published_shape::<N>(path, found),
                published_shape::<N>(path, expected)
            ),
            ApplyError::DTypeMismatch { path, expected, found } => {
                format!("mistyped: `{}` is {found:?}, expected {expected:?}", published_name(path))
            }
            ApplyError::AdapterError { path, message } | ApplyError::LoadError { path, message } => {
                format!("unreadable: `{}`: {message}", published_name(path))
            }
        };
        line(text, &mut shown);
    }
    for (path, _) in &result.missing {
        line(format!("missing: `{}`", published_name(path)), &mut shown);
    }
    for name in odd.names {
        line(format!("not finite: `{}`", published_name(&name)), &mut shown);
    }
    for name in unused {
        line(format!("unknown: `{name}`"), &mut shown);
    }
    if shown > SHOWN {
        let _ = write!(problems, "\n  and {} more", shown - SHOWN);
    }
    Err(WeightsError::Misfit {
        file: file.to_string(),
        problems,
        hint: "give the configuration (widths, heads) that the weights were trained with, or other weights",
    })
}

/// Names of tensors with a NaN or an infinity.
#[derive(Default)]
struct NotFinite {
    path: Vec<String>,
    names: Vec<String>,
}

impl ModuleVisitor for NotFinite {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_string());
    }
    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let data = param.val().into_data().convert::<f32>();
        if data.as_slice::<f32>().is_ok_and(|values| values.iter().any(|x| !x.is_finite())) {
            self.names.push(self.path.join("."));
        }
    }
}

/// Problems listed before the rest is only counted.
const SHOWN: usize = 12;

/// PyTorch's name of a parameter: norms keep `weight` and `bias` where burn has `gamma` and `beta`.
pub(super) fn published_name(path: &str) -> String {
    match path.rsplit_once('.') {
        Some((rest, "gamma")) => format!("{rest}.weight"),
        Some((rest, "beta")) => format!("{rest}.bias"),
        _ => path.to_string(),
    }
}

/// A shape as the file has it: linear weights transposed, convolutions with their kernel axis.
fn published_shape<N: Network>(path: &str, shape: &[usize]) -> Vec<usize> {
    let mut shape = shape.to_vec();
    let packed = path.ends_with("in_proj_weight");
    if shape.len() == 2 && !packed {
        shape.reverse();
        if N::is_conv(path) {
            shape.push(1);
        }
    }
    shape
}

/// The weight [o, i, 1] of a `Conv1d` of kernel 1 is that of a linear layer, [o, i].
#[derive(Clone, Debug)]
struct Squeeze;

impl ModuleAdapter for Squeeze {
    fn adapt(&self, tensor: Stored, context: ModuleContext<'_>) -> Stored {
        let is_weight = tensor.name.ends_with(".weight") && context.module_type() == Some("Struct:Linear");
        if !(is_weight && tensor.shape.len() == 3 && tensor.shape[2] == 1) {
            return tensor;
        }
        let shape = [tensor.shape[0], tensor.shape[1]];
        let (name, dtype) = (tensor.name.clone(), tensor.dtype);
        bridge::map_data(tensor, name, dtype, shape.into(), move |data| {
            let (bytes, _, dtype) = data.into_parts();
            TensorData::from_bytes(bytes, shape, dtype)
        })
    }

    fn clone_box(&self) -> Box<dyn ModuleAdapter> {
        Box::new(self.clone())
    }
}

fn dtype(dtype: Dtype) -> Option<DType> {
    Some(match dtype {
        Dtype::F64 => DType::F64,
        Dtype::F32 => DType::F32,
        Dtype::F16 => DType::F16,
        Dtype::BF16 => DType::BF16,
        Dtype::I64 => DType::I64,
        Dtype::I32 => DType::I32,
        Dtype::I16 => DType::I16,
        Dtype::I8 => DType::I8,
        Dtype::U64 => DType::U64,
        Dtype::U32 => DType::U32,
        Dtype::U16 => DType::U16,
        Dtype::U8 => DType::U8,
        Dtype::BOOL => DType::Bool(BoolStore::Native),
        _ => return None,
    })
}
