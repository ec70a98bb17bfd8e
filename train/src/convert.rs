//! `train convert`: weights between PyTorch files and checkpoint directories.

use crate::config::NetworkKind;
use crate::{TrainConfig, TrainError};
use burn::tensor::Device;
use clap::{Args, ValueEnum};
use formats::lock::try_lock_of;
use model::checkpoint::{self, Checkpoint};
use model::encode::{EncodeConfig, Fill, Normalisation, Orientation};
use model::published::{Network, Precision};
use model::{BenbvNet, BenbvNetConfig, PcNbvNet, PcNbvNetConfig};
use std::path::{Path, PathBuf};

/// What to convert, and how.
#[derive(Args, Debug)]
#[command(
    after_help = "Examples: train convert authors.pth weights/published    (PyTorch state dict -> checkpoint)\n          \
                        train convert runs/train/x/best net.safetensors    (checkpoint -> load_state_dict(strict=True))\n          \
                        train convert pc.safetensors weights/pc --set kind=pc-nbv --set pc_nbv.points=64"
)]
pub struct ConvertArgs {
    /// A .pth or .safetensors with PyTorch's names, or a checkpoint directory
    pub input: PathBuf,
    /// A checkpoint directory, or a .safetensors file
    pub output: PathBuf,
    /// Number format of the weights
    #[arg(long, value_enum, default_value_t = Format::F32)]
    pub precision: Format,
    /// Kind and sizes of the network and its input where the input is a file [default: BENBV-Net as published]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One such setting, e.g. --set network.points=1024 or --set kind=pc-nbv
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

/// Endings of files with weights that are not written here.
const FOREIGN: [&str; 6] = ["pth", "pt", "bin", "onnx", "ckpt", "npz"];

/// What to tell a user whose flags change nothing: those for the sizes of the network, where a checkpoint knows them.
pub fn without_effect(args: &ConvertArgs) -> Option<String> {
    let given = match (args.config.is_some(), args.set.is_empty()) {
        (true, true) => "--config has",
        (true, false) => "--config and --set have",
        (false, false) => "--set has",
        (false, true) => return None,
    };
    checkpoint::surviving(&args.input)
        .is_dir()
        .then(|| format!("{given} no effect: {:?} is read as a checkpoint, which says what network it is", args.input))
}

/// Converts.
///
/// # Errors
///
/// Unreadable or misfitting weights, named tensor by tensor; those of another kind of network than the settings say; settings that
/// are none; an output that another process writes, of a type that is not written here, or where something lies that is no
/// checkpoint.
pub fn convert(args: &ConvertArgs) -> Result<(), TrainError> {
    let input = &checkpoint::surviving(&args.input);
    check_places(input, &args.output)?;
    let _lock = try_lock_of(&args.output, "train convert")?;
    if !is_safetensors(&args.output) {
        checkpoint::check_replaceable(&args.output)?;
    }
    let device = model::device::open("cpu")?;
    let precision = match args.precision {
        Format::F32 => Precision::F32,
        Format::F16 => Precision::F16,
    };
    if input.is_dir() && checkpoint::kind(input)? == PcNbvNet::KIND {
        let (net, info) = checkpoint::load::<PcNbvNet>(input, &device)?;
        return write(args, &net, info, precision);
    }
    if input.is_dir() {
        let (net, info) = checkpoint::load::<BenbvNet>(input, &device)?;
        return write_benbv(args, &net, info, precision);
    }
    let config = settings(args)?;
    if config.kind == NetworkKind::PcNbv {
        let network = PcNbvNetConfig { points: config.pc_nbv.points, gain_unit: config.pc_nbv.gain_unit };
        let encode = EncodeConfig { points: network.points, ..EncodeConfig::default() };
        let (net, info) = import::<PcNbvNet>(input, network.clone(), encode, &device)?;
        write(args, &net, info, precision)?;
        let PcNbvNetConfig { points, gain_unit } = network;
        tracing::info!("clouds of {points} points (pc_nbv.points), gains in units of {gain_unit} (pc_nbv.gain_unit)");
        return Ok(());
    }
    let (net, info) = import::<BenbvNet>(input, config.network.clone(), config.encode(), &device)?;
    write_benbv(args, &net, info, precision)
}

/// What a file with weights does not say of them.
fn settings(args: &ConvertArgs) -> Result<TrainConfig, TrainError> {
    let mut set = Vec::new();
    if args.config.is_none() {
        set.extend(["input.normalisation=as_is".to_string(), "input.fill=zeros".to_string()]);
    }
    set.extend_from_slice(&args.set);
    Ok(formats::config::load(args.config.as_deref(), &set, &[]).map_err(formats::run::RunError::from)?)
}

/// The weights of a file.
fn import<N: Network>(
    file: &Path,
    network: N::Config,
    encode: EncodeConfig,
    device: &Device,
) -> Result<(N, Checkpoint<N::Config>), TrainError> {
    let net = checkpoint::import_pytorch::<N>(file, &network, device)
        .map_err(|error| other_kind(file, N::KIND).unwrap_or_else(|| error.into()))?;
    let mut info = Checkpoint::new::<N>(network, encode);
    info.provenance.insert("converted_from".into(), file.display().to_string());
    Ok((net, info))
}

/// What to tell a user whose file has weights of another kind of network.
fn other_kind(file: &Path, wanted: &str) -> Option<TrainError> {
    // A layer of each that the other has not.
    const LAYERS: [(&str, &str); 2] = [(PcNbvNet::KIND, "extractor."), (BenbvNet::KIND, "pos_feat.")];
    let tensors = model::published::read_file(file).ok()?;
    let (found, _) = LAYERS.into_iter().find(|(_, layer)| tensors.iter().any(|t| t.name.starts_with(layer)))?;
    (found != wanted).then(|| TrainError::Data {
        path: file.to_path_buf(),
        problem: format!("it has the weights of {found}, not of {wanted}"),
        way_out: format!("add --set kind={found}"),
    })
}

/// As [`write`], and says what the network is to be shown.
fn write_benbv(
    args: &ConvertArgs,
    net: &BenbvNet,
    info: Checkpoint<BenbvNetConfig>,
    precision: Precision,
) -> Result<(), TrainError> {
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
    write(args, net, info, precision)?;
    tracing::info!("clouds of {points} points, {frame}, {axes}, {fill}");
    Ok(())
}

/// Before anything is made, the lock included.
fn check_places(input: &Path, output: &Path) -> Result<(), TrainError> {
    let refuse = |path: &Path, problem: String, way_out: &str| {
        Err(TrainError::Data { path: path.to_path_buf(), problem, way_out: way_out.into() })
    };
    match input.try_exists() {
        Ok(true) => {}
        Ok(false) => {
            const WAY_OUT: &str =
                "name a .pth or .safetensors file, or a checkpoint directory such as runs/train/x/best";
            return refuse(input, "there is no such file or directory".into(), WAY_OUT);
        }
        Err(cause) => return Err(TrainError::io("read", input, cause)),
    }
    let ending = ending(output);
    if FOREIGN.contains(&ending.as_str()) {
        let problem = format!("files with the extension {ending:?} are not written here");
        return refuse(
            output,
            problem,
            "name a .safetensors file, which PyTorch's load_state_dict takes, or a directory without an extension for a checkpoint",
        );
    }
    if is_safetensors(output) && output.is_dir() {
        return refuse(output, "it is a directory, and a file is to be written".into(), "name a .safetensors file");
    }
    Ok(())
}

fn is_safetensors(path: &Path) -> bool {
    ending(path) == "safetensors"
}

/// The extension, lower case.
fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn write<N: Network>(
    args: &ConvertArgs,
    net: &N,
    mut info: Checkpoint<N::Config>,
    precision: Precision,
) -> Result<(), TrainError> {
    info.precision = precision;
    if is_safetensors(&args.output) {
        checkpoint::export_pytorch(net, &args.output, precision)?;
    } else {
        checkpoint::save(&args.output, net, &info)?;
    }
    tracing::info!("wrote {:?}", args.output);
    Ok(())
}

#[cfg(test)]
mod tests;
