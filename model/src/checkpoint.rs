//! Checkpoints: a directory with `model.safetensors` (published names), `checkpoint.toml` (all that is needed to use and to
//! trace the weights), and `SHA256SUMS`, against which they are held whenever they are read. Written beside its place and renamed, so that a reader sees the old one or the new
//! one and never half of either.

use crate::config::MOST;
use crate::encode::EncodeConfig;
use crate::published::{self, Network, Precision, WeightsError};
use crate::sums::{self, SUMS, Sums};
use burn::store::burn_pack::Tensor as Stored;
use burn::tensor::Device;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Version of `checkpoint.toml` that this program writes, and the only one it reads.
pub const SCHEMA_VERSION: u32 = 1;
/// Name of the weights in a checkpoint directory.
pub const WEIGHTS: &str = "model.safetensors";
/// Name of the description in a checkpoint directory.
pub const DESCRIPTION: &str = "checkpoint.toml";

/// What a checkpoint says of its weights. `C` is the network's configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint<C> {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// `benbv-net` or `pc-nbv`.
    pub kind: String,
    /// Optimizer steps behind the weights.
    #[serde(default)]
    pub step: u64,
    /// Number format of the weights on disk.
    #[serde(default)]
    pub precision: Precision,
    /// Sizes of the network.
    pub network: C,
    /// How observations become its input.
    #[serde(default)]
    pub encode: EncodeConfig,
    /// Where the weights come from: free keys such as `commit`, `config_sha256`, `data`, `seed`, `command`.
    #[serde(default)]
    pub provenance: BTreeMap<String, String>,
}

/// Why a checkpoint cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// A file cannot be read or written.
    #[error("{file}: {cause}")]
    Io {
        /// The file.
        file: String,
        /// The cause.
        cause: std::io::Error,
    },
    /// `checkpoint.toml` is not what it should be.
    #[error("{file}: {reason}")]
    Description {
        /// The file.
        file: String,
        /// The cause, with the place.
        reason: String,
    },
    /// The bytes are not those that were written.
    #[error(
        "{file}: damaged or edited: its SHA-256 is {found}, {SUMS} says {expected}; use another checkpoint or an intact copy, or, if the change is intended, delete {SUMS}"
    )]
    Damaged {
        /// The file.
        file: String,
        /// Checksum of what is there.
        found: String,
        /// Checksum that was recorded.
        expected: String,
    },
    /// Something else lies where a checkpoint is to be saved.
    #[error(
        "{place}: {found}, which saving a checkpoint there would delete; name a directory that is absent, empty, or a checkpoint and nothing else"
    )]
    Occupied {
        /// Where.
        place: String,
        /// What lies there.
        found: String,
    },
    /// The weights do not fit.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

impl<C> Checkpoint<C> {
    /// The description of fresh weights of network `N`.
    pub fn new<N: Network<Config = C>>(network: C, encode: EncodeConfig) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            kind: N::KIND.to_string(),
            step: 0,
            precision: Precision::F32,
            network,
            encode,
            provenance: BTreeMap::new(),
        }
    }
}

/// Whether a place that a user named may be given to [`save`]: it is absent, an empty directory, or a directory with the files
/// that [`save`] writes and nothing else (in `latest/` of a run of `train` there is more). So must be what an interrupted save
/// left beside it.
///
/// # Errors
/// What else is there, by name.
pub fn check_replaceable(directory: &Path) -> Result<(), CheckpointError> {
    for place in [Some(directory.to_path_buf()), aside_of(directory)].into_iter().flatten() {
        let odd =
            |(name, is_folder): &(String, bool)| *is_folder || ![WEIGHTS, DESCRIPTION, SUMS].contains(&name.as_str());
        if let Some((name, _)) = entries(&place)?.into_iter().find(odd) {
            return Err(occupied(&place, format!("it contains {name:?}")));
        }
    }
    Ok(())
}

/// Before a directory is replaced, whoever asks: it is empty, or has a file of a checkpoint. A checkpoint to which something was
/// added passes; no training ends for that.
fn check_is_none_of_others(directory: &Path, more: &[(&str, &[u8])]) -> Result<(), CheckpointError> {
    let entries = entries(directory)?;
    let own = |name: &str| [WEIGHTS, DESCRIPTION, SUMS].contains(&name) || more.iter().any(|(file, _)| *file == name);
    match entries.first() {
        Some((first, _)) if !entries.iter().any(|(name, is_folder)| !is_folder && own(name)) => {
            Err(occupied(directory, format!("it is no checkpoint and contains {first:?}")))
        }
        _ => Ok(()),
    }
}

/// What a directory contains, sorted, and whether each is a directory; nothing where there is none.
fn entries(directory: &Path) -> Result<Vec<(String, bool)>, CheckpointError> {
    let io = |cause| CheckpointError::Io { file: format!("{directory:?}"), cause };
    match fs::metadata(directory) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(io(error)),
        Ok(found) if !found.is_dir() => return Err(occupied(directory, "it is a file".to_owned())),
        Ok(_) => {}
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(directory).map_err(io)? {
        let entry = entry.map_err(io)?;
        let is_folder = entry.file_type().map_err(io)?.is_dir();
        found.push((entry.file_name().to_string_lossy().into_owned(), is_folder));
    }
    found.sort();
    Ok(found)
}

fn occupied(place: &Path, found: String) -> CheckpointError {
    CheckpointError::Occupied { place: format!("{place:?}"), found }
}

/// Writes the checkpoint to the directory, replacing an older one.
///
/// # Errors
/// A directory of something else, which stays as it is ([`check_replaceable`] is stricter); what the operating system refuses.
pub fn save<N: Network>(directory: &Path, net: &N, info: &Checkpoint<N::Config>) -> Result<(), CheckpointError> {
    save_with(directory, net, info, &[])
}

/// As [`save`], with further files (an optimizer's state), by name; all of them are put in place as a whole.
pub fn save_with<N: Network>(
    directory: &Path,
    net: &N,
    info: &Checkpoint<N::Config>,
    more: &[(&str, &[u8])],
) -> Result<(), CheckpointError> {
    let io = |file: &Path, source| CheckpointError::Io { file: format!("{file:?}"), cause: source };
    let parent = match directory.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    check_is_none_of_others(directory, more)?;
    fs::create_dir_all(&parent).map_err(|e| io(&parent, e))?;
    let name = directory.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let staging = tempfile::Builder::new()
        .prefix(&format!(".{name}."))
        .suffix(".partial")
        .tempdir_in(&parent)
        .map_err(|e| io(&parent, e))?;
    let weights = published::to_safetensors(net, info.precision)?;
    let description = describe(info, &directory.join(DESCRIPTION))?;
    let files = [&[(WEIGHTS, &weights[..]), (DESCRIPTION, description.as_bytes())], more].concat();
    for (name, bytes) in files.iter().copied().chain([(SUMS, sums::text(&files).as_bytes())]) {
        // The place that it is to have, not that of the moment.
        fs::write(staging.path().join(name), bytes).map_err(|e| io(&directory.join(name), e))?;
    }
    sync_files(staging.path()).map_err(|e| io(directory, e))?;

    // A directory cannot be renamed onto another: the old one steps aside first, and comes back on failure.
    let aside = parent.join(format!(".{name}.old"));
    if directory.exists() {
        let _ = fs::remove_dir_all(&aside);
        fs::rename(directory, &aside).map_err(|e| io(directory, e))?;
    }
    let staged = staging.keep();
    if let Err(error) = fs::rename(&staged, directory) {
        let _ = fs::rename(&aside, directory);
        let _ = fs::remove_dir_all(&staged);
        return Err(io(directory, error));
    }
    if let Ok(handle) = fs::File::open(&parent) {
        let _ = handle.sync_all();
    }
    let _ = fs::remove_dir_all(&aside);
    Ok(())
}

/// Reads network and description from a checkpoint directory. Where a crash came between the two renames of a save,
/// the previous checkpoint is taken.
pub fn load<N: Network>(directory: &Path, device: &Device) -> Result<(N, Checkpoint<N::Config>), CheckpointError> {
    let directory = &surviving(directory);
    let sums = Sums::read(directory)?;
    let info = read_description::<N::Config>(directory, &sums, Some(N::KIND))?;
    let file = directory.join(WEIGHTS);
    let bytes = fs::read(&file).map_err(|e| CheckpointError::Io { file: format!("{file:?}"), cause: e })?;
    sums.check(WEIGHTS, &bytes)?;
    let net = build::<N>(&info, &bytes, &format!("{:?}", directory.join(DESCRIPTION)), &file, device)?;
    Ok((net, info))
}

/// As [`load`], from memory: the texts of `checkpoint.toml` and the bytes of `model.safetensors` (embedded weights).
pub fn load_bytes<N: Network>(
    description: &str,
    weights: &[u8],
    device: &Device,
) -> Result<(N, Checkpoint<N::Config>), CheckpointError> {
    let name = "(embedded) checkpoint.toml";
    let info = parse_description::<N::Config>(description, name, Some(N::KIND))?;
    let net = build::<N>(&info, weights, name, Path::new("(embedded) model.safetensors"), device)?;
    Ok((net, info))
}

/// The kind of network in a checkpoint directory, without reading its weights.
pub fn kind(directory: &Path) -> Result<String, CheckpointError> {
    let directory = &surviving(directory);
    Ok(read_description::<toml::Table>(directory, &Sums::read(directory)?, None)?.kind)
}

/// What a checkpoint directory says of its weights, without reading them.
///
/// # Errors
/// No such file, damage, or another network's sizes.
pub fn description<C: DeserializeOwned>(directory: &Path) -> Result<Checkpoint<C>, CheckpointError> {
    let directory = &surviving(directory);
    read_description(directory, &Sums::read(directory)?, None)
}

/// A network of these sizes with the weights of a `.safetensors`, `.pth` or `.pt` file.
pub fn import_pytorch<N: Network>(file: &Path, config: &N::Config, device: &Device) -> Result<N, CheckpointError> {
    let tensors = published::read_file(file)?;
    let name = format!("{file:?}");
    check_size::<N>(config, &tensors, &name)
        .map_err(|reason| CheckpointError::Description { file: "settings".to_owned(), reason })?;
    let net = N::create(config, device).map_err(WeightsError::Config)?;
    Ok(published::apply(net, tensors, &name)?)
}

/// Writes the weights alone, as a `.safetensors` that PyTorch's `load_state_dict(strict=True)` takes.
pub fn export_pytorch<N: Network>(net: &N, file: &Path, precision: Precision) -> Result<(), CheckpointError> {
    let io = |source| CheckpointError::Io { file: format!("{file:?}"), cause: source };
    let bytes = published::to_safetensors(net, precision)?;
    let parent = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(parent).map_err(io)?;
    let mut staging = tempfile::NamedTempFile::new_in(parent).map_err(io)?;
    std::io::Write::write_all(&mut staging, &bytes).map_err(io)?;
    staging.as_file().sync_all().map_err(io)?;
    staging.persist(file).map_err(|e| io(e.error))?;
    Ok(())
}

fn build<N: Network>(
    info: &Checkpoint<N::Config>,
    weights: &[u8],
    description: &str,
    file: &Path,
    device: &Device,
) -> Result<N, CheckpointError> {
    let fail = |reason| CheckpointError::Description { file: description.to_string(), reason };
    if !(1..=MOST).contains(&info.encode.points) {
        return Err(fail(format!("[encode] points = {}: expected 1 to {MOST}", info.encode.points)));
    }
    let name = format!("{file:?}");
    let tensors = published::read_safetensors(weights, &name)?;
    check_size::<N>(&info.network, &tensors, &name).map_err(fail)?;
    let net = N::create(&info.network, device).map_err(|reason| fail(format!("[network] {reason}")))?;
    Ok(published::apply(net, tensors, &name)?)
}

/// Weights that any machine has room for.
const HARMLESS: f64 = 1e8;

/// Before any memory is asked for: the network of a mistyped width may be larger than the machine. One that is not is made,
/// so that the message can name what does not fit, tensor by tensor.
fn check_size<N: Network>(network: &N::Config, tensors: &[Stored], file: &str) -> Result<(), String> {
    let stored: f64 = tensors.iter().map(|t| t.shape.iter().map(|&n| n as f64).product::<f64>()).sum();
    let wanted = N::least_weights(network);
    if wanted > HARMLESS && wanted > 4.0 * stored {
        return Err(format!("[network] asks for more than {wanted:.0} weights, but {file} holds {stored:.0}"));
    }
    Ok(())
}

/// The directory, or, where a crash came between the two renames of a save, the previous checkpoint beside it.
pub fn surviving(directory: &Path) -> PathBuf {
    match aside_of(directory) {
        Some(aside) if !directory.exists() && aside.join(DESCRIPTION).exists() => aside,
        _ => directory.to_path_buf(),
    }
}

/// Where a save puts the previous checkpoint for the moment.
fn aside_of(directory: &Path) -> Option<PathBuf> {
    directory.file_name().map(|n| directory.with_file_name(format!(".{}.old", n.to_string_lossy())))
}

fn describe<C: Serialize>(info: &Checkpoint<C>, file: &Path) -> Result<String, CheckpointError> {
    toml::to_string(info).map_err(|e| CheckpointError::Description { file: format!("{file:?}"), reason: e.to_string() })
}

fn read_description<C: DeserializeOwned>(
    directory: &Path,
    sums: &Sums,
    kind: Option<&str>,
) -> Result<Checkpoint<C>, CheckpointError> {
    let file = directory.join(DESCRIPTION);
    let name = format!("{file:?}");
    let bytes = fs::read(&file).map_err(|cause| CheckpointError::Io { file: name.clone(), cause })?;
    sums.check(DESCRIPTION, &bytes)?;
    parse_description(&String::from_utf8_lossy(&bytes), &name, kind)
}

fn parse_description<C: DeserializeOwned>(
    text: &str,
    file: &str,
    kind: Option<&str>,
) -> Result<Checkpoint<C>, CheckpointError> {
    let fail = |reason| CheckpointError::Description { file: file.to_string(), reason };
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| fail(e.to_string()))?;
    // Version and kind come first: a newer schema or another network must not be reported as an unknown key.
    match table.get("schema_version").and_then(toml::Value::as_integer) {
        Some(version) if version == i64::from(SCHEMA_VERSION) => {}
        Some(version) => {
            return Err(fail(format!(
                "schema_version = {version}: this program reads {SCHEMA_VERSION}; use the program that wrote it"
            )));
        }
        None => return Err(fail(format!("no integer `schema_version`; expected {SCHEMA_VERSION}"))),
    }
    let found = table.get("kind").and_then(toml::Value::as_str).unwrap_or_default();
    if let Some(expected) = kind.filter(|expected| *expected != found) {
        return Err(fail(format!("kind = \"{found}\": expected a checkpoint of \"{expected}\"")));
    }
    toml::from_str(text).map_err(|e| fail(e.to_string()))
}

fn sync_files(directory: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(directory)? {
        fs::File::open(entry?.path())?.sync_all()?;
    }
    fs::File::open(directory)?.sync_all()
}
