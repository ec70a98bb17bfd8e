//! The files that a command is to write: asked about before anything is read, so that no measured scan is replaced and no result lost.

use crate::args::Args;
use anyhow::{Context, Result, bail};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Holds the files to write against those to read, and against each other.
///
/// # Errors
/// One that would be written over an input or over another output, is a directory, has the ending of another format, or cannot be written.
pub fn check(args: &Args) -> Result<()> {
    let mut taken: Vec<(&str, PathBuf)> = inputs(args).map(|(flag, path)| (flag, place(path))).collect();
    let outputs: [(&str, &Option<PathBuf>, &[&str]); 5] = [
        ("--report", &args.report, &[]),
        // Its endings are those of [`crate::plan::check`].
        ("--plan", &args.plan, &[]),
        ("--mesh", &args.mesh, &["ply", "stl"]),
        ("--cloud", &args.cloud, &["ply"]),
        ("--ply", &args.ply, &[]),
    ];
    for (flag, path, endings) in outputs.into_iter().filter_map(|(flag, path, of)| Some((flag, path.as_ref()?, of))) {
        check_ending(flag, path, endings)?;
        if path.is_dir() {
            bail!("{flag} {path:?}: a directory: name a file in it");
        }
        let place = place(path);
        if let Some((other, _)) = taken.iter().find(|(_, taken)| *taken == place) {
            bail!("{flag} {path:?}: the file of {other}, which would be overwritten: name another");
        }
        taken.push((flag, place));
        check_writable(path).with_context(|| format!("{flag} {path:?}"))?;
    }
    Ok(())
}

/// Begins a file as it will be begun, beside what is there, and takes it back: what the system will refuse is known before there is a
/// result to lose. Folders that are missing are not made, and nothing is written to a device or pipe.
fn check_writable(path: &Path) -> Result<()> {
    if path.exists() && !path.is_file() {
        return Ok(());
    }
    let folder = path.ancestors().skip(1).find(|folder| folder.exists()).unwrap_or(Path::new(""));
    let mut begun = false;
    let ended = formats::run::atomic_write_with(&folder.join(path.file_name().unwrap_or_default()), |_| {
        begun = true;
        Err(ErrorKind::Interrupted.into())
    });
    if !begun {
        ended?;
    }
    Ok(())
}

/// Refuses a name that says another format than is written; where none is named here, every name will do.
fn check_ending(flag: &str, path: &Path, endings: &[&str]) -> Result<()> {
    let found = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if endings.is_empty() || endings.contains(&found.as_str()) {
        return Ok(());
    }
    bail!("{flag} {path:?}: unknown extension .{found}, expected .{}", endings.join(" or ."))
}

/// The files that the command reads, with their flags.
fn inputs(args: &Args) -> impl Iterator<Item = (&'static str, &Path)> {
    let lists = [("--scan", &args.scan), ("--depth", &args.depth)];
    let paths = [("--views-from", &args.views_from), ("--robot", &args.robot), ("--config", &args.common.config)];
    let texts = [
        ("--object", &args.object),
        ("--camera", &args.camera),
        ("--flange-from-camera", &args.flange_from_camera),
        ("--camera-from-flange", &args.camera_from_flange),
    ];
    let texts = texts.into_iter().flat_map(|(flag, text)| text.iter().map(move |text| (flag, text)));
    let texts = texts.chain(args.pose.iter().map(|text| ("--pose", text)));
    lists
        .into_iter()
        .flat_map(|(flag, paths)| paths.iter().map(move |path| (flag, path.as_path())))
        .chain(paths.into_iter().filter_map(|(flag, path)| Some((flag, path.as_deref()?))))
        .chain(texts.filter_map(|(flag, text)| Some((flag, file(text)?))))
}

/// The file of FILE or FILE:NAME, where it is one and not numbers.
fn file(text: &str) -> Option<&Path> {
    let named = text.rsplit_once(':').map(|(file, _)| file);
    std::iter::once(text).chain(named).map(Path::new).find(|path| path.is_file())
}

/// The same for every name of a file, whether it exists or not.
fn place(path: &Path) -> PathBuf {
    let whole = || {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(whole).unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsString;

    #[test]
    fn no_file_that_is_read_is_written_over() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mine.ply");
        std::fs::write(&path, "").expect("a file");
        let mine = path.display().to_string();
        let refused = |words: &str, output: &str| {
            let words = words.replace("MINE", &mine);
            let words = words.split(' ').chain([output, &mine]).map(OsString::from);
            check(&Args::from_command_line(words).expect("flags")).map_err(|error| error.to_string())
        };
        for (words, flag) in [
            ("infer --scan MINE", "--scan"),
            ("infer --depth MINE --pose 0,0,0,0,0,0,1", "--depth"),
            ("infer --depth d.png --pose MINE", "--pose"),
            ("infer --depth d.png --pose MINE:0", "--pose"),
            ("infer --depth d.png --camera MINE:cam1", "--camera"),
            ("infer --scan a.ply --views-from MINE", "--views-from"),
            ("infer --scan a.ply --config MINE", "--config"),
            ("infer --scan a.ply --robot MINE --tool t", "--robot"),
            ("infer --scan a.ply --robot u --tool t --flange-from-camera MINE", "--flange-from-camera"),
            ("infer --scan a.ply --robot u --tool t --camera-from-flange MINE", "--camera-from-flange"),
            ("infer --object MINE", "--object"),
        ] {
            for output in ["--mesh", "--cloud", "--ply", "--report"] {
                let error = refused(words, output).expect_err(words);
                assert!(error.contains(&format!("the file of {flag},")), "{words} {output}: {error}");
            }
        }
        assert_eq!(refused("infer --object procedural:3", "--mesh"), Ok(()));
        assert_eq!(refused("infer --depth d.png --pose 0,0,0,0,0,0,1", "--mesh"), Ok(()));
    }

    #[test]
    fn what_cannot_be_written_is_refused_at_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let [file, new, deep] = ["page.html", "new.html", "a/b/new.html"].map(at);
        std::fs::write(&file, "mine").expect("a file");
        for path in [&file, &new, &deep] {
            check_writable(path).expect("it can be written");
        }
        let left: Vec<_> = std::fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.path()).collect();
        assert_eq!(left, std::slice::from_ref(&file), "nothing is made");
        assert_eq!(std::fs::read_to_string(&file).expect("read"), "mine");
        let error = format!("{:#}", check_writable(&file.join("deep/new.html")).expect_err("in a file"));
        assert!(error.contains("page.html\": cannot make the directory"), "{error}");
    }

    #[test]
    fn a_name_of_another_format_is_refused() {
        let checked = |words: &str| {
            let words = ["infer", "--scan", "a.ply"].into_iter().chain(words.split(' ')).map(OsString::from);
            check(&Args::from_command_line(words).expect("flags")).map_err(|error| error.to_string())
        };
        for (words, expected) in [
            ("--cloud c.xyz", "--cloud \"c.xyz\": unknown extension .xyz, expected .ply"),
            ("--cloud c", "expected .ply"),
            ("--mesh m.obj", "--mesh \"m.obj\": unknown extension .obj, expected .ply or .stl"),
        ] {
            let error = checked(words).expect_err(words);
            assert!(error.contains(expected), "{words}: {error}");
        }
        assert_eq!(checked("--cloud c.PLY --mesh m.stl --ply views --report page.htm"), Ok(()));
    }
}
