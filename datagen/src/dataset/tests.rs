use super::*;

/// An OFF file with a header as ModelNet40 has it.
const GLUED: &str = "OFF4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

fn put(root: &Path, files: &[&str]) {
    for file in files {
        let path = root.join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
        std::fs::write(path, if file.ends_with("obj") { obj } else { GLUED }).unwrap();
    }
}

fn names(config: &DatasetConfig) -> Vec<String> {
    list_objects(config, 0, 0.2).unwrap().into_iter().map(|o| o.name).collect()
}

fn message(config: &DatasetConfig) -> String {
    list_objects(config, 0, 0.2).expect_err("must be refused").to_string()
}

#[test]
fn modelnet40_splits_as_its_folders_say() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    put(
        root,
        &[
            "chair/train/chair_0002.off",
            "chair/train/chair_0001.OFF",
            "chair/test/chair_0009.off",
            "bed/train/bed_0001.off",
            "bed/readme.txt",
        ],
    );
    let config = DatasetConfig { name: DatasetName::ModelNet40, root: Some(root.into()), ..Default::default() };
    assert_eq!(names(&config), ["bed/bed_0001", "chair/chair_0001", "chair/chair_0002"]);
    assert_eq!(names(&DatasetConfig { per_category: Some(1), ..config.clone() }), ["bed/bed_0001", "chair/chair_0001"]);
    let test = DatasetConfig { split: Some(SplitChoice::Test), ..config.clone() };
    assert_eq!(names(&test), ["chair/chair_0009"]);
    let objects = list_objects(&test, 0, 0.2).unwrap();
    assert_eq!(objects[0].split, Split::Test);
    assert_eq!(load_mesh(&objects[0]).unwrap().triangles.len(), 4);

    let list = root.join("list.txt");
    std::fs::write(&list, "# the authors' choice\n'chair_0009',\nbed/train/bed_0001.off\nchair/chair_0001\n").unwrap();
    let listed = DatasetConfig { list: Some(list.clone()), ..config.clone() };
    assert_eq!(names(&listed), ["chair/chair_0009", "bed/bed_0001", "chair/chair_0001"]);
    std::fs::write(&list, "bed_0001\nsofa_0001\n").unwrap();
    let text = message(&listed);
    assert!(text.contains("line 2") && text.contains("sofa_0001"), "{text}");
}

#[test]
fn shapenet_of_both_versions() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    let all: Vec<String> = (0..40).map(|i| format!("02691156/id{i}/model.obj")).collect();
    put(root, &all.iter().map(String::as_str).collect::<Vec<_>>());
    put(
        root,
        &[
            "03001627/x/models/model_normalized.obj",
            "03001627/x/models/model_normalized.json",
            "03001627/y/images/a.obj",
        ],
    );
    let config = DatasetConfig { name: DatasetName::ShapeNet, root: Some(root.into()), ..Default::default() };
    let (train, test) = (names(&config), names(&DatasetConfig { split: Some(SplitChoice::Test), ..config.clone() }));
    assert_eq!(train.len() + test.len(), 41);
    assert!(test.len() > 2 && test.len() < 16 && test.iter().all(|t| !train.contains(t)), "{test:?}");
}

#[test]
fn folder_takes_any_tree() {
    let dir = tempfile::tempdir().unwrap();
    put(dir.path(), &["b/deep/x.off", "a.obj", "a.off", "notes.txt"]);
    let config = DatasetConfig { name: DatasetName::Folder, root: Some(dir.path().into()), ..Default::default() };
    assert_eq!(names(&config), ["a.obj", "a.off", "b/deep/x"]);
}

#[test]
fn names_stay_apart_on_every_disk() {
    let dir = tempfile::tempdir().unwrap();
    let config = DatasetConfig { name: DatasetName::Folder, root: Some(dir.path().into()), ..Default::default() };
    put(dir.path(), &["a.off", "a.OFF", "b.obj", "b.stl", "b.obj.off", "C/x.off", "c/X.off", "d.safetensors/y.off"]);
    let long = "n".repeat(240);
    put(dir.path(), &[&format!("{long}.off"), &format!("{long}.OFF")]);
    #[cfg(target_os = "linux")]
    for byte in [0xfe, 0xff] {
        use std::os::unix::ffi::OsStrExt;
        let name = [b"odd", &[byte][..], b".off"].concat();
        std::fs::write(dir.path().join(std::ffi::OsStr::from_bytes(&name)), GLUED).unwrap();
    }
    let all = names(&config);
    assert_eq!(all, names(&config), "the same every time");
    let mut lower: Vec<String> = all.iter().map(|name| name.to_lowercase()).collect();
    lower.sort();
    lower.dedup();
    assert_eq!(lower.len(), if cfg!(target_os = "linux") { 12 } else { 10 }, "{all:?}");
    assert_eq!(all.iter().filter(|n| n.starts_with("a.off~")).count(), 2, "{all:?}");
    assert!(all.contains(&"b.stl".to_owned()), "{all:?}");
    let parts = all.iter().flat_map(|name| name.split('/'));
    assert!(parts.clone().all(|part| part.len() < 200 && !part.ends_with(".safetensors")), "{all:?}");
}

#[test]
fn repository3d_is_for_evaluation_alone() {
    let dir = tempfile::tempdir().unwrap();
    put(dir.path(), &["Bunny.obj", "teapot.obj", "other.obj"]);
    let config = DatasetConfig { name: DatasetName::Repository3d, root: Some(dir.path().into()), ..Default::default() };
    assert_eq!(names(&config), ["bunny", "teapot"]);
    assert!(list_objects(&config, 0, 0.2).unwrap().iter().all(|o| o.split == Split::Test));
    assert!(message(&DatasetConfig { split: Some(SplitChoice::Train), ..config }).contains("only for evaluation"));
}

#[test]
fn sequences_are_listed_for_replay_and_are_no_meshes() {
    let dir = tempfile::tempdir().unwrap();
    put(dir.path(), &["b/sequence.json", "a/sequence.json", "c/other.json"]);
    let of =
        |root: &Path| DatasetConfig { name: DatasetName::Sequences, root: Some(root.into()), ..Default::default() };
    let names =
        |root: &Path| -> Vec<String> { list_sequences(&of(root)).unwrap().into_iter().map(|o| o.name).collect() };
    assert_eq!(names(dir.path()), ["a", "b"]);
    assert_eq!(names(&dir.path().join("b")), ["b"], "one of them alone");
    assert!(message(&of(dir.path())).contains("evaluate --dataset sequences"));
    let nothing = list_sequences(&of(&dir.path().join("c"))).expect_err("must be refused").to_string();
    assert!(nothing.contains("sequence.json") && nothing.contains("--root"), "{nothing}");
}

#[test]
fn a_wrong_root_explains_layout_and_source() {
    let dir = tempfile::tempdir().unwrap();
    for (name, words) in [
        (DatasetName::ModelNet40, ["<category>/{train,test}/*.off", "modelnet.cs.princeton.edu"]),
        (DatasetName::ShapeNet, ["model_normalized.obj", "shapenet.org"]),
        (DatasetName::Repository3d, ["happyBuddha", "graphics.stanford.edu"]),
        (DatasetName::Folder, [".stl", "any meshes"]),
    ] {
        for root in [dir.path().join("none"), dir.path().into()] {
            let text = message(&DatasetConfig { name, root: Some(root.clone()), ..Default::default() });
            for word in words.iter().chain(&["--root", &*root.display().to_string()]) {
                assert!(text.contains(word), "{word:?} is missing in: {text}");
            }
        }
    }
    let text = message(&DatasetConfig { name: DatasetName::ModelNet40, ..Default::default() });
    assert!(text.contains("\"data/modelnet40\"") && text.contains("no such directory"), "{text}");
}

#[test]
fn validation_objects_are_set_aside_by_name() {
    let config = DatasetConfig { objects: Some(50), ..Default::default() };
    let validation = |share| -> Vec<String> {
        let objects = list_objects(&config, 3, share).unwrap();
        objects.into_iter().filter(|o| o.split == Split::Validation).map(|o| o.name).collect()
    };
    assert_eq!(validation(0.2).len(), 10);
    assert_eq!(validation(0.2), validation(0.2));
    assert_eq!(validation(0.0).len(), 0);
    assert_eq!(validation(0.001).len(), 1, "one at least, else training flies blind");
    let train = names(&config);
    let test = names(&DatasetConfig { split: Some(SplitChoice::Test), ..config });
    assert!(test.iter().all(|t| !train.contains(t)));
}

#[test]
fn what_file_systems_leave_behind_is_no_object() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    put(
        root,
        &[
            "bed/train/bed_0001.off",
            "bed/train/._bed_0001.off",
            "bed/train/.bed_0002.off",
            "__MACOSX/train/bed_0001.off",
            "@eaDir/train/bed_0003.off",
            ".Trash-1000/train/bed_0004.off",
            "02691156/a/model.obj",
            "02691156/._a/model.obj",
            "bunny.obj",
            "._teapot.obj",
        ],
    );
    std::fs::create_dir(root.join("bed/train/folder.off")).unwrap();
    let of = |name| names(&DatasetConfig { name, root: Some(root.into()), ..Default::default() });
    assert_eq!(of(DatasetName::ModelNet40), ["bed/bed_0001"]);
    assert_eq!(of(DatasetName::Repository3d), ["bunny"]);
    assert_eq!(of(DatasetName::Folder), ["02691156/a/model", "bed/train/bed_0001", "bunny"]);
    assert_eq!(of(DatasetName::ShapeNet), ["02691156/a"]);
}

#[cfg(unix)]
#[test]
fn links_that_lead_nowhere_new_are_passed_over() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path().join("set");
    put(&root, &["a/x.off", "b/y.off"]);
    let elsewhere = dir.path().join("elsewhere");
    put(&elsewhere, &["z.off"]);
    symlink("..", root.join("a/up")).unwrap();
    symlink(&root, root.join("b/again")).unwrap();
    symlink(&elsewhere, root.join("more")).unwrap();
    symlink("nowhere", root.join("a/broken.off")).unwrap();
    symlink("/dev/zero", root.join("a/endless.off")).unwrap();
    symlink("x.off", root.join("a/same.off")).unwrap();
    // Reading from a pipe that nobody writes to would never end.
    let _ = std::process::Command::new("mkfifo").arg(root.join("a/pipe.off")).status();
    let config = DatasetConfig { name: DatasetName::Folder, root: Some(root), ..Default::default() };
    assert_eq!(names(&config), ["a/same", "a/x", "b/y", "more/z"]);
    let list = dir.path().to_owned();
    assert!(message(&DatasetConfig { list: Some(list), ..config }).contains("a directory"), "no list");
}
