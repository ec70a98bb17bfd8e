use super::*;

#[test]
fn what_is_written_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let window = DepthImage { origin: [1, 1], size: [2, 1], depth: vec![1.234, 0.0] };
    write_depth(&path, &window, 4, 3, 0.001).unwrap();
    let DepthFile { image, notes } = read_depth(&path, None).unwrap();
    assert_eq!(notes, Vec::<String>::new());
    assert_eq!(image.size, [4, 3]);
    for (column, row) in [(0, 0), (1, 1), (2, 1), (3, 2)] {
        assert_eq!(image.at(column, row), window.at(column, row), "pixel {column} {row}");
    }
}

#[test]
fn errors_name_found_and_expected() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    write_depth(&path, &DepthImage::default(), 4, 3, 0.001).unwrap();
    let good = std::fs::read(&path).unwrap();
    let text = |bytes: &[u8]| parse_depth(&path, bytes, None).expect_err("must fail").to_string();
    assert!(text(b"no image").contains("expected a PNG"));
    assert!(text(&good[..40]).contains("a.png"));
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[1, 2, 3]).unwrap();
    assert!(text(&bytes).contains("Rgb of Eight bits"));
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, 60_000, 60_000);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    drop(encoder.write_header().unwrap());
    assert!(!text(&bytes).is_empty());
    assert!(parse_depth(Path::new("a.jpg"), b"", None).expect_err("must fail").to_string().contains(".jpg"));
}

/// A NumPy file of one row.
fn npy(descr: &str, values: &[u8], columns: usize) -> DepthFile {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1, {columns}), }}\n");
    let length = (header.len() as u16).to_le_bytes();
    let bytes = [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), values].concat();
    parse_depth(Path::new("a.npy"), &bytes, None).unwrap()
}

#[test]
fn the_unit_given_counts_for_floats_too() {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";
    let values: Vec<u8> = [800f32, 900.0].iter().flat_map(|z| z.to_le_bytes()).collect();
    let bytes = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &values].concat();
    let read = |unit| parse_depth(Path::new("a.npy"), &bytes, unit).unwrap();
    assert_eq!((read(Some(0.001)).image.depth, read(Some(0.001)).notes.len()), (vec![0.8, 0.9], 0));
    assert!(read(Some(1e-6)).notes[0].contains("below 1 mm in the given unit"), "{:?}", read(Some(1e-6)).notes);
    let guessed = read(None);
    assert_eq!(guessed.image.depth, [800.0, 900.0]);
    assert!(guessed.notes[0].contains("--depth-unit 0.001"), "{:?}", guessed.notes);
    let metres: Vec<u8> = [1u16, 2, 1].iter().flat_map(|z| z.to_le_bytes()).collect();
    assert!(npy("<u2", &metres, 3).notes[0].contains("integers are read as millimetres"));
}

#[test]
fn far_values_that_stand_for_no_return() {
    let wide = |values: &[u16]| values.iter().flat_map(|z| z.to_le_bytes()).collect::<Vec<u8>>();
    let file = npy("<u2", &wide(&[800, 65535, 900]), 3);
    assert_eq!((&file.image.depth[..], file.notes.len()), (&[0.8, 0.0, 0.9][..], 1));
    let file = npy("<i2", &wide(&[800, 32767, 900]), 3);
    assert_eq!(file.image.depth[1], 0.0, "the largest of signed integers");
    assert_eq!(npy("<u2", &wide(&[800, 32767, 30000]), 3).notes.len(), 0);
    let file = npy("<u2", &wide(&[800, 10000, 900, 10000]), 4);
    assert!(file.notes[0].contains("2 pixels are all 10 m away, the others at most 0.9 m"), "{:?}", file.notes);
    assert_eq!(npy("<u2", &wide(&[800, 800, 800]), 3).notes.len(), 0, "a wall seen squarely");
}

#[test]
fn a_small_file_does_not_become_gigabytes() {
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, 30_000, 30_000);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_chunk(png::chunk::IDAT, &vec![0; 2_000_000]).unwrap();
    let text = parse_depth(Path::new("a.png"), &bytes, None).expect_err("large").to_string();
    assert!(text.contains("a.png") && text.contains("30000 x 30000 pixels would take 5149 MiB"), "{text}");
}

#[test]
fn pictures_of_depths_are_said_and_transparent_pixels_are_no_return() {
    let file = npy("|u1", &[200, 100, 255], 3);
    assert_eq!(file.image.depth, [0.2, 0.1, 0.0]);
    assert!(file.notes.iter().any(|note| note.contains("integers of one byte")), "{:?}", file.notes);
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, 3, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_trns(&[3, 9][..]);
    encoder.write_header().unwrap().write_image_data(&[3, 32, 3, 9, 3, 132]).unwrap();
    let file = parse_depth(Path::new("a.png"), &bytes, None).unwrap();
    assert_eq!(file.image.depth, [0.8, 0.0, 0.9]);
    assert_eq!(file.notes, ["1 transparent pixels are taken for pixels without a return"]);
}

#[test]
fn the_unit_of_a_cameras_file_is_said_unless_it_is_the_usual_one() {
    let note = |image: &str, given, told| told_unit(Path::new(image), given, told, "--depth-unit");
    assert_eq!(note("a.png", None, None), None);
    assert_eq!(note("a.png", None, Some(0.001)), None);
    assert_eq!(note("a.png", Some(0.0001), Some(0.001 * 0.1)), None);
    assert!(note("a.png", None, Some(0.0001)).expect("unusual").contains("read in units of 0.0001 m"));
    assert!(note("a.npy", None, Some(0.001)).expect("of floats, perhaps").contains("depth_scale"));
    let both = note("a.png", Some(0.001), Some(0.0001)).expect("which?");
    assert!(both.contains("units of 0.0001 m") && both.contains("0.001 m as --depth-unit says"), "{both}");
}
