use super::*;

#[test]
fn names_are_known_or_explained() {
    assert!(open("cpu").is_ok());
    assert!(open("gpu").unwrap_err().to_string().contains("unknown device `gpu`; this program has: cpu"));
    for name in NAMES {
        if !compiled_in().contains(&name) {
            let text = open(name).unwrap_err().to_string();
            assert!(text.contains(&format!("`cargo build --release -p train --features {name}`")), "{text}");
        }
    }
}
