//! Writing weights.

use super::{Network, WeightsError};
use burn::store::{BurnToPyTorchAdapter, bridge};
use burn::tensor::DType;
use safetensors::Dtype;
use safetensors::tensor::View;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::HashMap;

/// Number format of the weights on disk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 32 bit: what was trained, bit for bit.
    #[default]
    F32,
    /// 16 bit, running statistics excepted: half the size; scores move by up to about 1e-2.
    F16,
}

struct Written {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl View for Written {
    fn dtype(&self) -> Dtype {
        self.dtype
    }
    fn shape(&self) -> &[usize] {
        &self.shape
    }
    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }
    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

/// The weights as a safetensors file with PyTorch's names, layouts and counters of batches. The same weights give
/// the same bytes.
pub fn to_safetensors<N: Network>(net: &N, precision: Precision) -> Result<Vec<u8>, WeightsError> {
    let fail = |reason: String| WeightsError::Unreadable { file: "(export)".into(), format: "safetensors", reason };
    let mut written = Vec::new();
    for tensor in net.collect(None, Some(Box::new(BurnToPyTorchAdapter)), false) {
        let name = tensor.name.clone();
        let statistics = name.ends_with(".running_mean") || name.ends_with(".running_var");
        let data = bridge::into_data(tensor).map_err(|e| fail(format!("tensor `{name}`: {e}")))?;
        let half = precision == Precision::F16 && !statistics;
        let (kind, dtype) = if half { (DType::F16, Dtype::F16) } else { (DType::F32, Dtype::F32) };
        let data = data.convert_dtype(kind);
        let mut shape = data.shape().to_vec();
        if N::is_conv(&name) {
            shape.push(1);
        }
        if let Some(norm) = name.strip_suffix(".running_var") {
            let counter = Written { dtype: Dtype::I64, shape: vec![], bytes: 0i64.to_le_bytes().to_vec() };
            written.push((format!("{norm}.num_batches_tracked"), counter));
        }
        written.push((name, Written { dtype, shape, bytes: data.as_bytes().to_vec() }));
    }
    // One entry only: the order of a hash map must not reach the file.
    let metadata = HashMap::from([("format".to_string(), "pt".to_string())]);
    safetensors::serialize(written, Some(metadata)).map_err(|e| fail(e.to_string()))
}
