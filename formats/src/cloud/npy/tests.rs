use super::*;

/// A version 1.0 file.
pub(crate) fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn types_orders_and_shapes() {
    let path = Path::new("a.npy");
    let f64s: Vec<u8> = (0..6).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let file = parse(path, &npy("<f8", false, "(2, 3)", &f64s)).unwrap();
    assert_eq!(file.cloud.points[1].coords, nalgebra::Vector3::new(3.0, 4.0, 5.0));
    let file = parse(path, &npy("<f8", true, "(2, 3)", &f64s)).unwrap();
    assert_eq!(file.cloud.points[1].coords, nalgebra::Vector3::new(1.0, 3.0, 5.0));
    let big: Vec<u8> = (0..6).flat_map(|i| (i as f32).to_be_bytes()).collect();
    let file = parse(path, &npy(">f4", false, "(1, 6)", &big)).unwrap();
    assert_eq!((file.cloud.len(), file.cloud.has_normals(), file.notes.len()), (1, false, 1), "3 4 5 is no normal");
    let with: Vec<u8> = [0, 1, 2, 0, 0, 1, 3, 4, 5, 0, -1, 0].iter().flat_map(|&i| (i as f32).to_be_bytes()).collect();
    let file = parse(path, &npy(">f4", false, "(2, 6)", &with)).unwrap();
    assert_eq!((file.cloud.normals[1], file.notes.len()), (-nalgebra::Vector3::y(), 0));
    let trailed = [f64s.clone(), vec![0; 24]].concat();
    let file = parse(path, &npy("<f8", false, "(2, 3)", &trailed)).unwrap();
    assert!(file.notes[0].contains("24 bytes"), "{:?}", file.notes);
    let file = parse(path, &npy("<f8", false, "(2, 1, 3)", &f64s)).unwrap();
    assert_eq!(file.grid, Some(super::super::Grid { width: 1, height: 2, pixels: vec![0, 1] }));
}

#[test]
fn errors_name_place_found_and_expected() {
    let text = |bytes: &[u8]| parse(Path::new("a.npy"), bytes).expect_err("must fail").to_string();
    assert!(text(&npy("<f8", false, "(1000000000000, 3)", &[])).contains("3000000000000 numbers declared"));
    assert!(text(&npy("<f8", false, "(18446744073709551615, 18446744073709551615, 3)", &[])).contains("declared"));
    assert!(text(&npy("<f8", false, "(2, 2)", &[0; 32])).contains("expected (N, 3)"));
    assert!(text(&npy("<U8", false, "(1, 3)", &[0; 96])).contains("header"));
    assert!(text(b"not numpy").contains("header"));
    for shape in ["(0, 3)", "(0, 6)", "(0, 18446744073709551615, 3)"] {
        assert!(text(&npy("<f8", true, shape, &[])).contains("found 0 points"), "{shape}");
    }
    assert!(text(&npy("<f8", false, "(0, 4)", &[])).contains("found [0, 4], expected (N, 3)"));
}
