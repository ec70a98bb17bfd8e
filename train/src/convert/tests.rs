use super::*;
use model::{PcNbvModel, PcNbvNetConfig, pc_nbv::VIEWS};
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
    let size = |d: &std::path::Path| std::fs::metadata(d.join(checkpoint::WEIGHTS)).expect("weights").len();
    assert!(size(&output) < size(&input) * 6 / 10, "{} of {}", size(&output), size(&input));
    let points: Vec<Point3<f64>> = (0..32).map(|i| Point3::new(f64::from(i * i % 7), f64::from(i % 5), 0.1)).collect();
    let predict = |d: &std::path::Path| {
        let model = PcNbvModel::load(d).expect("loaded");
        assert_eq!(model.checkpoint().network, config);
        model.predict(&points, &[0.0; VIEWS]).expect("gains")
    };
    let largest = predict(&input).iter().zip(predict(&output)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest > 0.0 && largest < 1e-3, "{largest}");
}
