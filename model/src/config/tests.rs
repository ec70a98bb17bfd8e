use super::*;

#[test]
fn presets_are_valid_and_bad_sizes_named() {
    for name in ["paper", "compact", "tiny"] {
        BenbvNetConfig::preset(name).unwrap().validate().unwrap();
    }
    let bad = BenbvNetConfig { heads: 3, ..BenbvNetConfig::tiny() };
    assert!(bad.validate().unwrap_err().to_string().contains("heads = 3 must divide attention_width = 16"));
    let bad = BenbvNetConfig { position_widths: vec![8, 0], ..BenbvNetConfig::tiny() };
    assert!(bad.validate().unwrap_err().to_string().contains("position_widths"));
    let bad = BenbvNetConfig { dropout: 1.0, ..BenbvNetConfig::tiny() };
    assert!(bad.validate().unwrap_err().to_string().contains("dropout"));
}
