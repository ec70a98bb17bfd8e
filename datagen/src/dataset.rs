//! Which objects: data sets of meshes by name, and the built-in family of solids.

mod folder;
mod modelnet40;
mod names;
mod procedural;
mod repository3d;
mod selection;
mod sequences;
mod shapenet;

pub(crate) use selection::assign_splits;

use formats::{FormatError, Split};
use geometry::Mesh;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The data sets that are known by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DatasetName {
    /// Built in: an endless, seeded family of watertight solids.
    #[default]
    Procedural,
    /// `<root>/<category>/{train,test}/*.off`.
    ModelNet40,
    /// v1 `<root>/<synset>/<id>/model.obj`, v2 `<root>/<synset>/<id>/models/model_normalized.obj`.
    ShapeNet,
    /// The paper's eight evaluation objects.
    Repository3d,
    /// Any tree of meshes.
    Folder,
    /// Recorded scans, `<root>/<name>/sequence.json`: for `evaluate` alone ([`list_sequences`]).
    Sequences,
}

impl DatasetName {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Procedural, Self::ModelNet40, Self::ShapeNet, Self::Repository3d, Self::Folder, Self::Sequences];

    /// Name on the command line, in configuration files and in paths.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Procedural => "procedural",
            Self::ModelNet40 => "modelnet40",
            Self::ShapeNet => "shapenet",
            Self::Repository3d => "repository3d",
            Self::Folder => "folder",
            Self::Sequences => "sequences",
        }
    }
}

/// Which half of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SplitChoice {
    /// For training and validation.
    Train,
    /// For judging the result.
    Test,
}

/// Which objects.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DatasetConfig {
    /// Name of the data set.
    pub name: DatasetName,
    /// Where it lies; absent: `data/<name>`.
    pub root: Option<PathBuf>,
    /// Which half; absent: `train`, and `test` for `repository3d`, which is for evaluation alone.
    pub split: Option<SplitChoice>,
    /// Take this many of each category, in the order of their names; absent: all.
    pub per_category: Option<usize>,
    /// A file that names the models to take, one per line; absent: no such list.
    pub list: Option<PathBuf>,
    /// Take this many objects; absent: all (20 of `procedural`).
    pub objects: Option<usize>,
}

impl DatasetConfig {
    /// Where the data set lies.
    pub fn root(&self) -> PathBuf {
        self.root.clone().unwrap_or_else(|| Path::new("data").join(self.name.as_str()))
    }

    /// Which half.
    pub fn split(&self) -> SplitChoice {
        self.split.unwrap_or(match self.name {
            DatasetName::Repository3d | DatasetName::Sequences => SplitChoice::Test,
            _ => SplitChoice::Train,
        })
    }
}

/// An object of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name, unique in its set, e.g. `airplane/airplane_0001`.
    pub name: String,
    /// Category, or the data set's name where it has none.
    pub category: String,
    /// What its samples are for.
    pub split: Split,
    /// Where its surface comes from.
    pub source: Source,
}

/// Where a surface comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A mesh file.
    File(PathBuf),
    /// The file of a recorded sequence.
    Sequence(PathBuf),
    /// A member of the built-in family.
    Procedural {
        /// Seed of the family.
        seed: u64,
        /// Which member.
        index: u64,
    },
}

/// Why a data set cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The root is missing, empty or of another layout.
    #[error(
        "no {name} under {root:?}: found {found}, expected {layout}; {source_of_data}; if it is elsewhere, give its directory with --root DIR"
    )]
    Layout {
        /// Name of the data set.
        name: &'static str,
        /// Where it was looked for.
        root: PathBuf,
        /// What is there.
        found: String,
        /// What should be there.
        layout: &'static str,
        /// Where it is obtained.
        source_of_data: &'static str,
    },
    /// A directory or list cannot be read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A list names a model that is not there.
    #[error(
        "{list:?}, line {line}: no model {entry:?} under {root:?}; expected a name as `--list-objects` prints it, a path below the root, or a file name"
    )]
    Unlisted {
        /// The list.
        list: PathBuf,
        /// The line.
        line: usize,
        /// What it says.
        entry: String,
        /// Where it was looked for.
        root: PathBuf,
    },
    /// The choice cannot be met.
    #[error("{0}")]
    Choice(String),
}

/// The objects of a run in the order of the work list: sorted by name, or as the list names them.
///
/// # Errors
/// A root of another layout, with what is expected and where the set is obtained; a list that does not fit; recorded
/// sequences, which are no meshes.
pub fn list_objects(config: &DatasetConfig, seed: u64, validation_share: f64) -> Result<Vec<Object>, DatasetError> {
    if config.name == DatasetName::Procedural {
        return procedural::list(config, seed, validation_share);
    }
    let root = config.root();
    let choice = config.split();
    let found = match config.name {
        DatasetName::ModelNet40 => modelnet40::find(&root)?,
        DatasetName::ShapeNet => shapenet::find(&root)?,
        DatasetName::Repository3d => repository3d::find(&root, choice)?,
        DatasetName::Folder | DatasetName::Procedural => folder::find(&root)?,
        DatasetName::Sequences => return Err(DatasetError::Choice(NO_MESHES.to_owned())),
    };
    let found = names::distinct(&root, found)?;
    let found = selection::select(config, &root, choice, found)?;
    let objects = found.into_iter().map(|f| Object {
        name: f.name,
        category: f.category,
        split: Split::Train,
        source: Source::File(f.path),
    });
    Ok(assign_splits(objects.collect(), choice, seed, validation_share))
}

const NO_MESHES: &str = "recorded sequences are not meshes: only `evaluate --dataset sequences` replays them; choose another --dataset here";

/// The recorded sequences of a root, by name.
///
/// # Errors
/// A root without any, a list that does not fit.
pub fn list_sequences(config: &DatasetConfig) -> Result<Vec<Object>, DatasetError> {
    let root = config.root();
    let found = selection::select(config, &root, SplitChoice::Test, sequences::find(&root)?)?;
    let object =
        |f: Found| Object { name: f.name, category: f.category, split: Split::Test, source: Source::Sequence(f.path) };
    Ok(found.into_iter().map(object).collect())
}

/// The surface of an object, in its own unit.
///
/// # Errors
/// Why its file cannot be used.
pub fn load_mesh(object: &Object) -> Result<Mesh, FormatError> {
    match &object.source {
        Source::File(path) | Source::Sequence(path) => formats::read_mesh(path),
        Source::Procedural { seed, index } => Ok(crate::procedural::mesh(*seed, *index)),
    }
}

/// A mesh file with its place in the data set.
#[derive(Clone, Debug)]
struct Found {
    name: String,
    category: String,
    path: PathBuf,
    /// Which half the data set itself puts it in.
    half: Option<SplitChoice>,
}

/// What file systems and other programs leave among people's files, beside all that is hidden (`._airplane_0001.off`).
const LITTER: [&str; 6] = ["__macosx", "@eadir", "#recycle", "$recycle.bin", "system volume information", "lost+found"];

/// Regular files and directories in a directory, sorted by name, hidden ones and litter left out; none where it does not
/// exist.
fn entries(directory: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let reader = match std::fs::read_dir(directory) {
        Ok(reader) => reader,
        Err(e) if matches!(e.kind(), std::io::ErrorKind::NotFound | std::io::ErrorKind::NotADirectory) => {
            return Ok(vec![]);
        }
        Err(e) => return Err(FormatError::io(directory, "read the directory", e).into()),
    };
    let mut paths = vec![];
    for entry in reader {
        let path = entry.map_err(|e| FormatError::io(directory, "read the directory", e))?.path();
        let name = file_name(&path).to_lowercase();
        // Links count as what they lead to; pipes, devices and links that lead nowhere are no objects.
        if !name.starts_with('.') && !LITTER.contains(&name.as_str()) && (path.is_file() || path.is_dir()) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// What is at a root, for a message.
fn describe(root: &Path) -> String {
    if !root.exists() {
        return "no such directory".to_owned();
    }
    if !root.is_dir() {
        return "a file".to_owned();
    }
    let all = entries(root).unwrap_or_default();
    let names: Vec<String> = all.iter().take(4).map(|p| file_name(p)).collect();
    match all.len() {
        0 => "an empty directory".to_owned(),
        n if n > names.len() => format!("{} and {} more", names.join(", "), n - names.len()),
        _ => names.join(", "),
    }
}

#[cfg(test)]
mod tests;
