//! Weights of PyTorch (`.safetensors`, `.pth`) in, the same weights as `.safetensors` for PyTorch out.
//!
//!     cargo run --release -p model --example convert -- in.pth out.safetensors [f16] [paper|compact|tiny]

use burn::tensor::Device;
use model::published::Precision;
use model::{BenbvNet, BenbvNetConfig, checkpoint};
use std::path::Path;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to, rest @ ..] = arguments.as_slice() else {
        return Err("usage: convert IN OUT.safetensors [f16] [paper|compact|tiny]".into());
    };
    let (mut precision, mut config) = (Precision::F32, BenbvNetConfig::paper());
    for word in rest {
        match (word.as_str(), BenbvNetConfig::preset(word)) {
            ("f16", _) => precision = Precision::F16,
            (_, Some(preset)) => config = preset,
            _ => return Err(format!("unknown word `{word}`; expected f16, paper, compact or tiny").into()),
        }
    }
    let net: BenbvNet = checkpoint::import_pytorch(Path::new(from), &config, &Device::flex())?;
    checkpoint::export_pytorch(&net, Path::new(to), precision)?;
    println!("wrote {to}");
    Ok(())
}
