use super::*;
use model::{PcNbvModel, pc_nbv::VIEWS};
use nalgebra::Point3;

#[test]
fn a_checkpoint_of_pc_nbv_is_converted_as_what_it_is() {
    let folder = tempfile::tempdir().expect("temp");
    let (input, output) = (folder.path().join("full"), folder.path().join("half"));
    let config = PcNbvNetConfig { points: 32, gain_unit: 0.05 };
    let net = config.init(&model::device::open("cpu").expect("cpu"));
    let info = Checkpoint::new::<PcNbvNet>(config.clone(), EncodeConfig::default());
    checkpoint::save(&input, &net, &info).expect("saved");
    let args = ConvertArgs {
        input: input.clone(),
        output: output.clone(),
        precision: Format::F16,
        config: None,
        set: Vec::new(),
    };
    let held = try_lock_of(&output, "another run").expect("free");
    let busy = convert(&args).expect_err("held").to_string();
    assert!(busy.contains("half\" is in use") && busy.contains("another run"), "{busy}");
    assert!(!output.exists(), "nothing is written");
    drop(held);
    convert(&args).expect("converted");
    let size = |d: &Path| std::fs::metadata(d.join(checkpoint::WEIGHTS)).expect("weights").len();
    assert!(size(&output) < size(&input) * 6 / 10, "{} of {}", size(&output), size(&input));
    let points: Vec<Point3<f64>> = (0..32).map(|i| Point3::new(f64::from(i * i % 7), f64::from(i % 5), 0.1)).collect();
    let predict = |d: &Path| {
        let model = PcNbvModel::load(d).expect("loaded");
        assert_eq!(model.checkpoint().network, config);
        model.predict(&points, &[0.0; VIEWS]).expect("gains")
    };
    let largest = predict(&input).iter().zip(predict(&output)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest > 0.0 && largest < 1e-3, "{largest}");
}

/// A checkpoint of a small network, and what converts it to this output.
fn small(folder: &Path, output: &str) -> ConvertArgs {
    let input = folder.join("from");
    let config = PcNbvNetConfig { points: 32, gain_unit: 0.05 };
    let info = Checkpoint::new::<PcNbvNet>(config.clone(), EncodeConfig::default());
    checkpoint::save(&input, &config.init(&model::device::open("cpu").expect("cpu")), &info).expect("saved");
    ConvertArgs { input, output: folder.join(output), precision: Format::F16, config: None, set: Vec::new() }
}

#[test]
fn weights_of_pc_nbv_come_back_from_a_file() {
    let folder = tempfile::tempdir().expect("temp");
    let place = |name: &str| folder.path().join(name);
    let given = |input: &str, output: &str, set: &[&str]| {
        let set = set.iter().map(|s| (*s).to_string()).collect();
        ConvertArgs { input: place(input), output: place(output), precision: Format::F32, config: None, set }
    };
    convert(&ConvertArgs { precision: Format::F32, ..small(folder.path(), "net.safetensors") }).expect("exported");
    let set = ["kind=pc-nbv", "pc_nbv.points=32", "pc_nbv.gain_unit=0.05"];
    convert(&given("net.safetensors", "back", &set)).expect("imported");
    let settings = place("pc.toml");
    std::fs::write(&settings, "kind = \"pc-nbv\"\n[pc_nbv]\npoints = 32\ngain_unit = 0.05\n").expect("written");
    let by_file = ConvertArgs { config: Some(settings), ..given("net.safetensors", "by-file", &[]) };
    convert(&by_file).expect("imported");
    let points: Vec<Point3<f64>> = (0..32).map(|i| Point3::new(f64::from(i * i % 7), f64::from(i % 5), 0.1)).collect();
    let predict = |name: &str| {
        let model = PcNbvModel::load(&place(name)).expect("loaded");
        assert_eq!(model.checkpoint().network, PcNbvNetConfig { points: 32, gain_unit: 0.05 });
        model.predict(&points, &[0.0; VIEWS]).expect("gains")
    };
    assert_eq!(predict("back"), predict("from"));
    assert_eq!(predict("by-file"), predict("from"));

    // Each kind of weights taken for the other.
    let text = convert(&given("net.safetensors", "x", &[])).expect_err("PC-NBV's").to_string();
    assert!(text.contains("it has the weights of pc-nbv, not of benbv-net; add --set kind=pc-nbv"), "{text}");
    let net = BenbvNet::create(&BenbvNetConfig::tiny(), &model::device::open("cpu").expect("cpu")).expect("sizes");
    checkpoint::export_pytorch(&net, &place("benbv.safetensors"), Precision::F32).expect("exported");
    let text = convert(&given("benbv.safetensors", "x", &["kind=pc-nbv"])).expect_err("BENBV-Net's").to_string();
    assert!(text.contains("it has the weights of benbv-net, not of pc-nbv; add --set kind=benbv-net"), "{text}");
    let text = convert(&given("benbv.safetensors", "x", &[])).expect_err("other sizes").to_string();
    assert!(text.contains("misshaped"), "{text}");
    assert!(!place("x").exists());
}

#[test]
fn what_is_at_the_output_is_not_deleted() {
    let folder = tempfile::tempdir().expect("temp");
    let work = folder.path().join("work");
    std::fs::create_dir_all(work.join("inner")).expect("made");
    std::fs::write(work.join("inner/thesis.txt"), "years").expect("written");
    std::fs::write(folder.path().join("plain"), "a file").expect("written");
    for (output, word) in [("work", "inner"), ("plain", "it is a file")] {
        let text = convert(&small(folder.path(), output)).expect_err("something else").to_string();
        assert!(text.contains(output) && text.contains(word) && text.contains("absent, empty"), "{text}");
    }
    assert_eq!(std::fs::read_to_string(work.join("inner/thesis.txt")).expect("there"), "years");
    assert_eq!(std::fs::read_to_string(folder.path().join("plain")).expect("there"), "a file");
    std::fs::create_dir(folder.path().join("empty")).expect("made");
    for output in ["empty", "new", "new", "from", "net.SafeTensors", "net.safetensors"] {
        convert(&small(folder.path(), output)).expect(output);
    }
    assert!(folder.path().join("net.SafeTensors").is_file());
    // Something that was added to a checkpoint would be lost with it.
    std::fs::write(folder.path().join("new/notes.txt"), "").expect("written");
    let text = convert(&small(folder.path(), "new")).expect_err("notes").to_string();
    assert!(text.contains("notes.txt"), "{text}");
}

#[test]
fn outputs_of_other_types_and_inputs_that_are_not_there_are_said_so() {
    let folder = tempfile::tempdir().expect("temp");
    for output in ["w/x.pth", "w/x.PT", "w/x.onnx", "w/x.bin"] {
        let text = convert(&small(folder.path(), output)).expect_err("another type").to_string();
        assert!(text.contains("not written here") && text.contains("name a .safetensors file"), "{text}");
    }
    let mut args = small(folder.path(), "w/x");
    args.input = folder.path().join("nothere");
    let text = convert(&args).expect_err("no such file").to_string();
    assert!(text.contains("nothere\": there is no such file or directory"), "{text}");
    assert!(!folder.path().join("w").exists(), "nothing is made");
}

#[test]
fn settings_of_a_network_have_no_effect_on_a_checkpoint() {
    let folder = tempfile::tempdir().expect("temp");
    let mut args = small(folder.path(), "x");
    assert_eq!(without_effect(&args), None);
    args.set.push("network.points=8".into());
    assert!(without_effect(&args).is_some_and(|text| text.contains("--set has no effect") && text.contains("from")));
    args.config = Some("a.toml".into());
    assert!(without_effect(&args).is_some_and(|text| text.contains("--config and --set have no effect")));
    args.input = folder.path().join("authors.pth");
    assert_eq!(without_effect(&args), None, "a file does not say its sizes");
}
