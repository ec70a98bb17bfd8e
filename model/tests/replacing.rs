//! What a save replaces, and what it leaves alone.
#![allow(missing_docs)]

use burn::tensor::Device;
use model::encode::EncodeConfig;
use model::{BenbvNet, BenbvNetConfig, checkpoint};

#[test]
fn what_is_no_checkpoint_is_not_replaced() {
    let folder = tempfile::tempdir().expect("temp");
    let place = |name: &str| folder.path().join(name);
    let config = BenbvNetConfig::tiny();
    let info = checkpoint::Checkpoint::new::<BenbvNet>(config.clone(), EncodeConfig::paper());
    let net = config.init(&Device::flex());
    let save = |name: &str| checkpoint::save(&place(name), &net, &info);
    std::fs::create_dir_all(place("thesis/chapters")).expect("made");
    std::fs::write(place("thesis/notes.txt"), "years").expect("written");
    std::fs::write(place("plain"), "a file").expect("written");
    for (name, word) in [("thesis", "contains \"chapters\""), ("plain", "it is a file")] {
        let text = save(name).expect_err("something else").to_string();
        assert!(text.contains(word) && text.contains(name) && text.contains("absent, empty"), "{text}");
        checkpoint::check_replaceable(&place(name)).expect_err("something else");
    }
    assert_eq!(std::fs::read_to_string(place("thesis/notes.txt")).expect("there"), "years");
    assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 2, "and nothing beside it");

    std::fs::create_dir(place("empty")).expect("made");
    for name in ["empty", "absent", "absent"] {
        checkpoint::check_replaceable(&place(name)).expect("may be replaced");
        save(name).expect("saved");
    }
    assert_eq!(checkpoint::description::<BenbvNetConfig>(&place("absent")).expect("read"), info);
    // More than the weights: the training loop replaces its own, a user's choice of a place does not.
    checkpoint::save_with(&place("latest"), &net, &info, &[("training.bpk", &[1])]).expect("saved");
    let text = checkpoint::check_replaceable(&place("latest")).expect_err("a training's state").to_string();
    assert!(text.contains("training.bpk"), "{text}");
    checkpoint::save_with(&place("latest"), &net, &info, &[("training.bpk", &[2])]).expect("replaced");
    // Interrupted between the renames: the only state there is lies beside.
    std::fs::rename(place("latest"), place(".latest.old")).expect("renamed");
    checkpoint::check_replaceable(&place("latest")).expect_err("a training's state");
    assert_eq!(checkpoint::surviving(&place("latest")), place(".latest.old"));
    checkpoint::save_with(&place("latest"), &net, &info, &[("training.bpk", &[3])]).expect("saved");
    assert!(place("latest").exists() && !place(".latest.old").exists());
}
