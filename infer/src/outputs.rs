//! The files that a command is to write: asked about before anything is read, so that no measured scan is replaced and no result lost.

use crate::args::Args;
use anyhow::{Result, bail};
use std::path::{Path, PathBuf};

/// Holds the files to write against those to read, and against each other.
///
/// # Errors
/// One that would be written over an input or over another output, or is a directory.
pub fn check(args: &Args) -> Result<()> {
    let inputs = args.scan.iter().map(|path| ("--scan", path)).chain(args.depth.iter().map(|path| ("--depth", path)));
    let inputs = inputs.chain(args.views_from.iter().map(|path| ("--views-from", path)));
    let mut taken: Vec<(&str, PathBuf)> = inputs.map(|(flag, path)| (flag, place(path))).collect();
    let outputs = [
        ("--report", &args.report),
        ("--plan", &args.plan),
        ("--mesh", &args.mesh),
        ("--cloud", &args.cloud),
        ("--ply", &args.ply),
    ];
    for (flag, path) in outputs.into_iter().filter_map(|(flag, path)| Some((flag, path.as_ref()?))) {
        if path.is_dir() {
            bail!("{flag} {path:?}: a directory: name a file in it");
        }
        let place = place(path);
        if let Some((other, _)) = taken.iter().find(|(_, taken)| *taken == place) {
            bail!("{flag} {path:?}: the file of {other}, which would be overwritten: name another");
        }
        taken.push((flag, place));
    }
    Ok(())
}

/// The same for every name of a file, whether it exists or not.
fn place(path: &Path) -> PathBuf {
    let whole = || {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(whole).unwrap_or_else(|| path.to_owned())
}
