use super::*;

fn triangle(header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(1u32.to_le_bytes());
    for x in [0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        bytes.extend(x.to_le_bytes());
    }
    bytes.extend([0, 0]);
    bytes
}

#[test]
fn text_and_binary_whatever_the_header_says() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nVERTEX 0 1 0\nendloop\nendfacet\n";
    let two = format!("solid\n{facet}endsolid\nSOLID b\n{}endsolid b\n", facet.replace("0 0 0", "0 0 5"));
    let path = Path::new("a.stl");
    assert_eq!(parse(path, two.as_bytes()).unwrap().triangles.len(), 2, "both solids");
    for header in [&b"solid of an exporter"[..], b"", b"COLOR="] {
        assert_eq!(parse(path, &triangle(header)).unwrap().area(), 0.5);
        let trailed = [triangle(header), b"made by hand".to_vec()].concat();
        assert_eq!(parse(path, &trailed).unwrap().area(), 0.5, "bytes behind the last triangle");
    }
    let wide = two.encode_utf16().flat_map(u16::to_le_bytes);
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(wide).collect();
    for bytes in [format!("\u{feff}{two}").into_bytes(), two.replace('\n', "\r").into_bytes(), wide] {
        assert_eq!(parse(path, &bytes).unwrap().triangles.len(), 2, "{bytes:?}");
    }
}

#[test]
fn errors_name_place_found_and_expected() {
    let error = |bytes: &[u8]| parse(Path::new("a.stl"), bytes).expect_err("must fail").to_string();
    let mut huge = triangle(b"");
    huge[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(error(&huge).contains("byte 80: 4294967295 triangles declared, but the file has room for 1"));
    assert!(error(b"solid a\nvertex 1 2 x\n").contains("line 2: found \"x\""));
    assert!(error(b"solid a\nvertex 1 2 3\nendloop").contains("line 3: found a facet of 1 vertices"));
    assert!(error(b"solid a\nvertex 1 2 3\n").contains("ends here"));
    assert!(error(b"solid a\nendsolid a\n\n").contains("found no facet, expected"));
    assert!(
        error(b"solid a\nfacet normal 0 0 1\nouter loop\n").contains("found no facet; the text ends without endsolid")
    );
    assert!(error(b"").contains("0 bytes"));
}

#[test]
fn facets_without_an_end_and_triangles_sent_as_text_are_refused() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let error = |bytes: &[u8]| parse(Path::new("a.stl"), bytes).expect_err("must fail").to_string();
    let open = format!("solid\n{}{facet}endsolid\n", facet.replace("endloop\n", ""));
    assert!(
        error(open.as_bytes()).contains("line 7: found \"endfacet\", expected endloop"),
        "{}",
        error(open.as_bytes())
    );
    let mut bytes = triangle(b"");
    for k in 0..3 {
        bytes[96 + 12 * k] = b'\n';
    }
    assert!(parse(Path::new("a.stl"), &bytes).is_ok());
    let sent: Vec<u8> = bytes.iter().flat_map(|b| if *b == b'\n' { vec![b'\r', b'\n'] } else { vec![*b] }).collect();
    assert!(error(&sent).contains("carriage return before every line feed"), "{}", error(&sent));
}
