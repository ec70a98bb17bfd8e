//! What kind of output a directory holds. `datagen`, `train` and `evaluate` each keep a `config.toml` and a `run.toml`: in the
//! directory of another program they would overwrite files and leave a mixture that none of them can resume.

use std::fmt;
use std::path::{Path, PathBuf};

/// What our programs leave in a directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// Training samples, made by `datagen`.
    DataSet,
    /// A run of `train`.
    Training,
    /// A run of `evaluate`.
    Evaluation,
    /// A checkpoint: the weights of a network.
    Checkpoint,
}

const KINDS: [OutputKind; 4] =
    [OutputKind::DataSet, OutputKind::Training, OutputKind::Evaluation, OutputKind::Checkpoint];

impl fmt::Display for OutputKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            OutputKind::DataSet => "a data set of `datagen`",
            OutputKind::Training => "a run of `train`",
            OutputKind::Evaluation => "a run of `evaluate`",
            OutputKind::Checkpoint => "a checkpoint",
        })
    }
}

/// A directory holds the output of another program.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{directory:?} contains {found} ({file}), and {wanted} there would overwrite its files; give another --out")]
pub struct OutputError {
    /// The directory.
    pub directory: PathBuf,
    /// What is there.
    pub found: OutputKind,
    /// The file or directory in it that says so.
    pub file: String,
    /// What was to be written.
    pub wanted: OutputKind,
}

/// Whether output of this kind may be written to a directory: it is absent, or holds nothing that another of our programs
/// wrote. Writes nothing.
///
/// # Errors
/// What is there instead, and the file that says so.
pub fn check_output(directory: &Path, wanted: OutputKind) -> Result<(), OutputError> {
    match outputs(directory).into_iter().find(|(kind, _)| *kind != wanted) {
        None => Ok(()),
        Some((found, file)) => Err(OutputError { directory: directory.to_owned(), found, file, wanted }),
    }
}

/// The kinds of output in a directory, each with the file that says so: one that a single program writes. Only where there is
/// none, in a run that has come to nothing yet, `run.toml` counts: in mixtures that older programs made, it is the last writer's.
pub fn outputs(directory: &Path) -> Vec<(OutputKind, String)> {
    let marked = |kind: OutputKind| {
        let marker = markers(kind).iter().find(|marker| directory.join(marker).exists())?;
        Some((kind, (*marker).to_owned()))
    };
    let found: Vec<_> = KINDS.into_iter().filter_map(marked).collect();
    if found.is_empty() { noted(directory).into_iter().collect() } else { found }
}

/// What only one program writes, and only in such a directory.
fn markers(kind: OutputKind) -> &'static [&'static str] {
    match kind {
        OutputKind::DataSet => &[formats::manifest::MANIFEST, "shards"],
        // The second one is left where a save was interrupted.
        OutputKind::Training => &["latest/training.toml", ".latest.old/training.toml", "best/checkpoint.toml"],
        OutputKind::Evaluation => &["journal.jsonl"],
        OutputKind::Checkpoint => &["checkpoint.toml"],
    }
}

/// The program that is named in `run.toml`, or in that of a part.
fn noted(directory: &Path) -> Option<(OutputKind, String)> {
    let names = directory.read_dir().ok()?.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let is_note = |name: &String| name == "run.toml" || (name.starts_with("run-") && name.ends_with(".toml"));
    let mut names: Vec<String> = names.filter(is_note).collect();
    names.sort();
    names.into_iter().find_map(|name| {
        let bytes = formats::file::read(&directory.join(&name)).ok()?;
        let note: toml::Table = String::from_utf8_lossy(&bytes).parse().ok()?;
        let kind = match note.get("program")?.as_str()?.split_whitespace().next()? {
            "datagen" => OutputKind::DataSet,
            "train" => OutputKind::Training,
            "evaluate" => OutputKind::Evaluation,
            _ => return None,
        };
        Some((kind, name))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_output_of_another_program_is_named_with_the_file_that_says_so() {
        let home = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| {
            let path = home.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        for (directory, file, kind) in [
            ("set", "manifest.json", OutputKind::DataSet),
            ("begun", "shards/a.safetensors", OutputKind::DataSet),
            ("run", "latest/training.toml", OutputKind::Training),
            ("cut", ".latest.old/training.toml", OutputKind::Training),
            ("journal", "journal.jsonl", OutputKind::Evaluation),
            ("weights", "checkpoint.toml", OutputKind::Checkpoint),
        ] {
            put(&format!("{directory}/{file}"), "");
            // What was made counts, not who wrote last: older programs did not look.
            put(&format!("{directory}/run.toml"), "program = \"evaluate 1.0.0\"\n");
            let directory = home.path().join(directory);
            for wanted in KINDS {
                let checked = check_output(&directory, wanted);
                assert_eq!(checked.is_ok(), wanted == kind, "{directory:?}: {checked:?}");
            }
        }
        let text = check_output(&home.path().join("set"), OutputKind::Training).expect_err("a set").to_string();
        assert!(
            text.contains("set\" contains a data set of `datagen` (manifest.json), and a run of `train`"),
            "{text}"
        );
        assert!(text.contains("give another --out"), "{text}");
    }

    #[test]
    fn a_run_that_made_nothing_yet_is_known_by_its_note() {
        let home = tempfile::tempdir().unwrap();
        check_output(&home.path().join("absent"), OutputKind::Training).unwrap();
        check_output(home.path(), OutputKind::Training).unwrap();
        std::fs::write(home.path().join("config.toml"), "seed = 1\n").unwrap();
        check_output(home.path(), OutputKind::Training).expect("nobody's");
        std::fs::write(home.path().join("run-0-of-2.toml"), "program = \"datagen 1.0.0\"\n").unwrap();
        assert_eq!(outputs(home.path()), [(OutputKind::DataSet, "run-0-of-2.toml".to_owned())]);
        assert!(check_output(home.path(), OutputKind::Evaluation).is_err());
        check_output(home.path(), OutputKind::DataSet).unwrap();
        assert!(!home.path().join("absent").exists(), "looking makes nothing");
    }
}
