//! `train convert`: weights between PyTorch files and checkpoint directories.

use crate::{TrainConfig, TrainError};
use clap::{Args, ValueEnum};
use formats::lock::try_lock_of;
use model::checkpoint::{self, Checkpoint};
use model::encode::{EncodeConfig, Fill, Normalisation, Orientation};
use model::published::{Network, Precision};
use model::{BenbvNet, PcNbvNet};
use std::path::PathBuf;

/// What to convert, and how.
#[derive(Args, Debug)]
#[command(
    after_help = "Examples: train convert authors.pth weights/published    (PyTorch state dict -> checkpoint)\n          \
                        train convert runs/train/x/best net.safetensors    (checkpoint -> load_state_dict(strict=True))"
)]
pub struct ConvertArgs {
    /// A .pth or .safetensors with PyTorch's names, or a checkpoint directory
    pub input: PathBuf,
    /// A checkpoint directory, or a .safetensors file
    pub output: PathBuf,
    /// Number format of the weights
    #[arg(long, value_enum, default_value_t = Format::F32)]
    pub precision: Format,
    /// Sizes of the network and its input where the input is a file [default: as published]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One such setting, e.g. --set network.points=1024
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Number formats of weights on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// 4 bytes a number, exact.
    F32,
    /// 2 bytes a number; scores move by up to 0.01.
    F16,
}

/// Converts.
///
/// # Errors
///
/// Unreadable or misfitting weights, named tensor by tensor; settings that are none; an output that another process writes.
pub fn convert(args: &ConvertArgs) -> Result<(), TrainError> {
    let _lock = try_lock_of(&args.output, "train convert")?;
    let device = model::device::open("cpu")?;
    let precision = match args.precision {
        Format::F32 => Precision::F32,
        Format::F16 => Precision::F16,
    };
    if args.input.is_dir() && checkpoint::kind(&args.input)? == PcNbvNet::KIND {
        let (net, info) = checkpoint::load::<PcNbvNet>(&args.input, &device)?;
        return write(args, &net, info, precision);
    }
    let (net, info) = if args.input.is_dir() {
        checkpoint::load::<BenbvNet>(&args.input, &device)?
    } else {
        let mut set = Vec::new();
        if args.config.is_none() {
            set.extend(["input.normalisation=as_is".to_string(), "input.fill=zeros".to_string()]);
        }
        set.extend_from_slice(&args.set);
        let config: TrainConfig =
            formats::config::load(args.config.as_deref(), &set, &[]).map_err(formats::run::RunError::from)?;
        let net = checkpoint::import_pytorch::<BenbvNet>(&args.input, &config.network, &device)?;
        let mut info = Checkpoint::new::<BenbvNet>(config.network.clone(), config.encode());
        info.provenance.insert("converted_from".into(), args.input.display().to_string());
        (net, info)
    };
    let EncodeConfig { points, normalisation, orientation, fill, .. } = info.encode;
    let frame = match normalisation {
        Normalisation::AsIs => "as is",
        Normalisation::Cloud => "normalised to the cloud",
    };
    let axes = match orientation {
        Orientation::AsIs => "the world's axes",
        Orientation::MeanNormal => "mean normal upwards",
    };
    let fill = match fill {
        Fill::Repeat => "repeated",
        Fill::Zeros => "zero-padded",
    };
    write(args, &net, info, precision)?;
    tracing::info!("clouds of {points} points, {frame}, {axes}, {fill}");
    Ok(())
}

fn write<N: Network>(
    args: &ConvertArgs,
    net: &N,
    mut info: Checkpoint<N::Config>,
    precision: Precision,
) -> Result<(), TrainError> {
    info.precision = precision;
    if args.output.extension().is_some_and(|e| e == "safetensors") {
        checkpoint::export_pytorch(net, &args.output, precision)?;
    } else {
        checkpoint::save(&args.output, net, &info)?;
    }
    tracing::info!("wrote {:?}", args.output);
    Ok(())
}

#[cfg(test)]
mod tests;
