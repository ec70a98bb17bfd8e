use super::*;

fn read(text: &str) -> Result<Mesh, FormatError> {
    parse(Path::new("a.off"), text.as_bytes())
}

#[test]
fn headers_of_all_kinds() {
    let body = "0 0 0\n1 0 0 # here\n\n0 1 0 255 0 0\n1 1 0\n4 0 1 3 2 0.5 0.5\n";
    for header in ["OFF\n4 1 0", "OFF4 1 0", "OFF 4 1 0", "# c\n\n  COFF\n4\n1 0", "4 1 4", "OFF\r\n4 1"] {
        let mesh = read(&format!("{header}\n{body}")).unwrap_or_else(|e| panic!("{header:?}: {e}"));
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 2), "{header:?}");
        assert_eq!(mesh.area(), 1.0, "{header:?}");
    }
}

#[test]
fn errors_name_line_found_and_expected() {
    let text = |t: &str| read(t).expect_err(t).to_string();
    assert!(text("OFF\n1 1 0\n0 0 zero\n3 0 0 0").contains("line 3: found \"zero\", expected a coordinate"));
    assert!(
        text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7").contains("line 6: found vertex index 7, expected one of 3")
    );
    assert!(text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1").contains("index -1"));
    assert!(text("OFF\n3 1 0\n0 0 0\n1 0 0").contains("the file ends here"));
    assert!(text("OFF1000000000000 1 0\n").contains("1000000000000 vertices declared"));
    assert!(text("OFF BINARY\n").contains("expected OFF"));
    assert!(text("solid x\n").contains("line 1"));
    assert!(text("").contains("nothing usable"));
    assert!(text("OFF 0 0 0").contains("found 0 vertices and 0 faces"));
}

#[test]
fn marks_and_line_ends_of_any_system() {
    let text = "OFF\n3 1 0\n0 0 0\n1. 0 0\n.0 1 0\n3 0 1 2\n";
    let wide = text.encode_utf16().flat_map(u16::to_le_bytes);
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(wide).collect();
    for bytes in [text.replace('\n', "\r").into_bytes(), format!("\u{feff}{text}").into_bytes(), wide] {
        assert_eq!(parse(Path::new("a.off"), &bytes).unwrap().area(), 0.5, "{bytes:?}");
    }
}

#[test]
fn survey_coordinates_keep_their_corners() {
    let mesh = read("OFF3 1 0\n5600000.01 0 0\n5600000.02 0 0\n5600000.01 0.01 0\n3 0 1 2\n").unwrap();
    assert!((mesh.area() - 0.5e-4).abs() < 1e-8, "{}", mesh.area());
}

#[test]
fn useless_triangles_are_left_out() {
    let mesh =
        read("OFF 5 6 0\n0 0 0\n1 0 0\n0 1 0\nnan 0 0\n2 0 0\n3 0 1 2\n3 1 2 0\n3 2 1 0\n3 0 1 3\n3 0 1 1\n3 0 1 4\n");
    let mesh = mesh.unwrap();
    assert_eq!(mesh.triangles.len(), 2, "one triangle and the same seen from behind");
    assert!(mesh.vertices.iter().all(|v| v.iter().all(|x| x.is_finite())));
}
