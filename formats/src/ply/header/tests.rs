use super::*;

fn error(text: &str) -> String {
    parse(Path::new("a.ply"), text.as_bytes()).expect_err(text).to_string()
}

#[test]
fn any_line_end_and_any_name() {
    let text = "PLY\nformat binary_little_endian 1.0\ncomment Ger\u{e4}t\nelement vertex 2\nproperty Float32 X\n\
                property int64 stamp\nproperty float scalar_C2C_distances[<0.1]\nproperty list uchar int of it\nend_header\n";
    let header = parse(Path::new("a.ply"), text.as_bytes()).unwrap();
    assert_eq!((header.line, header.body), (10, text.len()));
    let element = &header.elements[0];
    let names: Vec<_> = element.properties.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["X", "stamp", "scalar_C2C_distances[<0.1]", "of it"]);
    assert_eq!((element.find("x"), element.find("y")), (Some(0), None));
    for (end, behind) in [("\r", "\n1"), ("\r\n", "\n1"), ("\n", "\r1")] {
        let text = text.replace('\n', end);
        let bytes = [text.as_bytes(), behind.as_bytes()].concat();
        let header = parse(Path::new("a.ply"), &bytes).unwrap();
        assert_eq!(header.body, text.len(), "the body begins behind the end of line {end:?}");
    }
}

#[test]
fn errors_name_the_line() {
    let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float q\n";
    assert!(error(&format!("{head}property float q\n")).contains("line 5: found property \"q\""));
    assert!(error(&format!("{head}element vertex 2\n")).contains("line 5: found element \"vertex\" a second time"));
    assert!(error(&format!("{head}property half z\n")).contains("line 5: found the type \"half\""));
    assert!(error(&format!("{head}property float\n")).contains("line 5"));
    assert!(error(head).contains("expected end_header"));
    assert!(error("ply\nformat ascii_2 1.0\n").contains("line 2: found the format \"ascii_2\""));
    assert!(error("ply\nend_header\n").contains("no format"));
}
