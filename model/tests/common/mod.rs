//! Reading recorded tensors, and a network's tensors by name.
#![allow(dead_code)] // Each test binary takes its part.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use model::NetInput;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The repository's own small recorded data.
pub fn data_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data")
}

/// A larger file of the published network; `None`, said in words, where it does not lie beside the checkout.
pub fn bonus_file(name: &str) -> Option<PathBuf> {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/golden")).join(name);
    if !file.exists() {
        println!("bonus test skipped: {name} of the published network is not beside this checkout");
        return None;
    }
    Some(file)
}

/// Tensors of a safetensors file, floats as f32.
pub struct Golden(BTreeMap<String, (Vec<usize>, Vec<f32>)>);

impl Golden {
    pub fn read(file: &Path) -> Self {
        Self::parse(&std::fs::read(file).unwrap_or_else(|e| panic!("{file:?}: {e}")))
    }

    pub fn parse(bytes: &[u8]) -> Self {
        let file = safetensors::SafeTensors::deserialize(bytes).expect("safetensors");
        let tensor = |(name, view): (&str, safetensors::tensor::TensorView)| {
            let bytes = view.data();
            let values = match view.dtype() {
                safetensors::Dtype::F32 => bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
                safetensors::Dtype::F64 => {
                    bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect()
                }
                _ => Vec::new(),
            };
            (name.to_string(), (view.shape().to_vec(), values))
        };
        Self(file.iter().map(tensor).collect())
    }

    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    pub fn floats(&self, name: &str) -> Vec<f32> {
        self.0.get(name).unwrap_or_else(|| panic!("no `{name}` recorded")).1.clone()
    }

    pub fn shape(&self, name: &str) -> &[usize] {
        &self.0[name].0
    }

    /// Names that begin so, without the beginning, sorted.
    pub fn names(&self, prefix: &str) -> Vec<String> {
        self.0.keys().filter_map(|name| name.strip_prefix(prefix)).map(String::from).collect()
    }

    fn tensor<const D: usize>(&self, name: &str, device: &Device) -> Tensor<D> {
        Tensor::from_data(TensorData::new(self.floats(name), self.shape(name).to_vec()), device)
    }

    /// The recorded batch P [B,N,6], S [B,K,6], C [B,K+1,1], all candidates real.
    pub fn input(&self, device: &Device) -> NetInput {
        let (cloud, candidates): (Tensor<3>, Tensor<3>) = (self.tensor("P", device), self.tensor("S", device));
        let context: Tensor<3> = self.tensor("C", device);
        let ([b, n, _], [_, k, _]) = (cloud.dims(), candidates.dims());
        assert_eq!(cloud.dims(), [b, n, 6]);
        NetInput {
            points: cloud.clone().narrow(2, 0, 3),
            normals: cloud.narrow(2, 3, 3),
            targets: candidates.clone().narrow(2, 0, 3),
            directions: candidates.narrow(2, 3, 3),
            density: context.clone().narrow(1, 0, k).reshape([b, k]),
            view_order: context.narrow(1, k, 1).reshape([b, 1]),
            past: None,
            counts: vec![k; b],
        }
    }

    /// The recorded scores y, [B, K].
    pub fn target(&self, device: &Device) -> Tensor<2> {
        let (data, shape) = (self.floats("y"), self.shape("y"));
        Tensor::from_data(TensorData::new(data, [shape[0], shape[1]]), device)
    }
}

/// |a - b| / |b|.
pub fn relative_l2(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square = |x: f64| x * x;
    let difference: f64 = a.iter().zip(b).map(|(a, b)| square(f64::from(*a) - f64::from(*b))).sum();
    (difference / b.iter().map(|b| square(f64::from(*b))).sum::<f64>()).sqrt()
}

struct Named<'a> {
    path: Vec<(String, String)>,
    grads: Option<&'a Gradients>,
    found: BTreeMap<String, Vec<f32>>,
}

impl Named<'_> {
    fn add<const D: usize>(&mut self, tensor: Tensor<D>) {
        let mut names: Vec<_> = self.path.iter().map(|(name, _)| name.as_str()).collect();
        let last = match names.pop() {
            Some("gamma") => "weight",
            Some("beta") => "bias",
            Some(name) => name,
            None => "",
        };
        names.push(last);
        // PyTorch keeps the weights of linear layers transposed.
        let linear = self.path.iter().rev().nth(1).is_some_and(|(_, kind)| kind == "Struct:Linear")
            || self.path.last().is_some_and(|(_, kind)| kind == "Struct:Linear");
        let data = tensor.clone().into_data();
        let data = match (linear, D) {
            (true, 2) => {
                let [i, o] = [data.shape()[0], data.shape()[1]];
                let values = data.try_to_vec::<f32>().expect("f32");
                (0..o * i).map(|at| values[(at % i) * o + at / i]).collect()
            }
            _ => data.try_to_vec::<f32>().expect("f32"),
        };
        self.found.insert(names.join("."), data);
    }
}

impl ModuleVisitor for Named<'_> {
    fn enter_module(&mut self, name: &str, kind: &str) {
        self.path.push((name.to_string(), kind.to_string()));
    }
    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        match self.grads {
            Some(grads) => {
                if let Some(gradient) = param.val().grad(grads) {
                    self.add(gradient);
                }
            }
            None => self.add(param.val().without_autodiff()),
        }
    }
}

/// Gradients by PyTorch's names and in its layout (convolutions flat).
pub fn gradients<M: Module>(net: &M, grads: &Gradients) -> BTreeMap<String, Vec<f32>> {
    let mut named = Named { path: Vec::new(), grads: Some(grads), found: BTreeMap::new() };
    net.visit(&mut named);
    named.found
}

/// Parameters and running statistics by PyTorch's names and in its layout.
pub fn parameters<M: Module>(net: &M) -> BTreeMap<String, Vec<f32>> {
    let mut named = Named { path: Vec::new(), grads: None, found: BTreeMap::new() };
    net.visit(&mut named);
    named.found
}

/// Trainable numbers: without running statistics, which burn's `num_params` counts too.
pub fn parameter_count<M: Module>(net: &M) -> usize {
    parameters(net).iter().filter(|(name, _)| !name.contains("running_")).map(|(_, values)| values.len()).sum()
}

/// A network's export as shapes and values by name.
pub fn tensors<N: model::published::Network>(net: &N) -> BTreeMap<String, (Vec<usize>, Vec<f32>)> {
    let bytes = model::published::to_safetensors(net, model::published::Precision::F32).expect("export");
    let mut all = Golden::parse(&bytes).0;
    all.retain(|name, _| !name.ends_with("num_batches_tracked"));
    all
}

/// Those as a safetensors file.
pub fn to_bytes(tensors: &BTreeMap<String, (Vec<usize>, Vec<f32>)>) -> Vec<u8> {
    let bytes: Vec<_> = tensors
        .iter()
        .map(|(name, (shape, values))| {
            (name, shape.clone(), values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())
        })
        .collect();
    let views = bytes.iter().map(|(name, shape, bytes)| {
        let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes).expect("view");
        (name.as_str(), view)
    });
    safetensors::serialize(views, None).expect("bytes")
}
