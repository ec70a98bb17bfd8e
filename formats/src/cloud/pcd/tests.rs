use super::*;

const HEAD: &str = "VERSION .7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n\
                    COUNT 1 1 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 2\n";

fn numbers() -> Vec<f32> {
    (0..12).map(|i| i as f32).collect()
}

#[test]
fn text_and_binary() {
    let text = format!("{HEAD}DATA ascii\n0 1 2 3 4 5\n6 7 8 9 10 11\n");
    let mut binary = format!("{HEAD}DATA binary\n").into_bytes();
    binary.extend(numbers().iter().flat_map(|x| x.to_le_bytes()));
    for bytes in [text.as_bytes(), &binary] {
        let file = parse(Path::new("a.pcd"), bytes).unwrap();
        assert_eq!(file.cloud.points[1].coords, nalgebra::Vector3::new(6.0, 7.0, 8.0));
        assert_eq!(file.cloud.normals[1], nalgebra::Vector3::new(9.0, 10.0, 11.0));
        assert_eq!(file.viewpoint, Some(Isometry3::translation(1.0, 2.0, 3.0)));
    }
}

#[test]
fn errors_name_place_found_and_expected() {
    let text = |bytes: &[u8]| parse(Path::new("a.pcd"), bytes).expect_err("must fail").to_string();
    let ascii = format!("{HEAD}DATA ascii\n0 1 2 3 4 5\n6 7 x 9 10 11\n");
    assert!(text(ascii.as_bytes()).contains("line 12"), "{}", text(ascii.as_bytes()));
    for kind in ["ascii", "binary", "binary_compressed"] {
        let huge = format!("{HEAD}DATA {kind}\nabcdefghij").replace("POINTS 2", "POINTS 1000000000000");
        assert!(text(huge.as_bytes()).contains("1000000000000 points declared"), "{kind}");
        let wide = format!("{HEAD}DATA {kind}\n").replace("COUNT 1", "COUNT 18446744073709551615");
        assert!(text(wide.as_bytes()).contains("numbers per point"), "{kind}");
    }
    let mut block = format!("{HEAD}DATA binary_compressed\n").into_bytes();
    block.extend([255; 8]);
    assert!(text(&block).contains("4294967295 compressed bytes declared"), "{}", text(&block));
    assert!(text(HEAD.replace("FIELDS x", "FIELDS w").as_bytes()).contains("header"));
    let other = format!("{}DATA ascii\n0 1 2 3 4 5\n6 7 8 9 10 11\n", HEAD.replace("FIELDS x", "FIELDS w"));
    assert!(text(other.as_bytes()).contains("x y z among them"));
    let none = format!("{HEAD}DATA ascii\n").replace("POINTS 2", "POINTS 0");
    assert!(text(none.as_bytes()).contains("found 0 points"));
}

#[test]
fn headers_of_the_field() {
    let text = "# Ger\u{e4}t\nVERSION .7\nFIELDS x y z _ nx ny nz\nSIZE 4 4 4 1 4 4 4\nTYPE F F F U F F F\nCOUNT 1 1 1 0 1 1 1\n\
                WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n0 1 2 3 4 5\n\n6 7 8 -1.#IND 10 11\n";
    let latin1: Vec<u8> = text.chars().map(|c| c as u8).collect();
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    for bytes in [latin1, text.replace('\n', "\r\n").into(), text.replace('\n', "\r").into(), wide] {
        let file = parse(Path::new("a.pcd"), &bytes).unwrap();
        assert_eq!(file.cloud.points[1].coords, nalgebra::Vector3::new(6.0, 7.0, 8.0));
        assert_eq!(file.cloud.normals, [nalgebra::Vector3::new(3.0, 4.0, 5.0), nalgebra::Vector3::zeros()]);
    }
    let text = |t: String| parse(Path::new("a.pcd"), t.as_bytes()).expect_err("must fail").to_string();
    let ascii = format!("{HEAD}DATA ascii\n0 1 2 3 4 5\n6 7 8 9 10 11\n");
    assert!(text(ascii.replace("normal_x", "x")).contains("\"x\" a second time"));
    assert!(text(ascii.replace("7 8", "7")).contains("line 12: found 5 numbers, expected 6"));
    assert!(text(ascii.replace("SIZE 4 4", "SIZE 4")).contains("5 entries for 6 fields"));
    assert!(text(ascii.replace("TYPE F", "TYPE Q")).contains("field \"x\" of TYPE Q"));
}

#[test]
fn what_follows_the_declared_points_is_said() {
    let ascii = format!("{HEAD}DATA ascii\n0 1 2 3 4 5\n6 7 8 9 10 11\n12 13 14 15 16 17\n");
    let mut binary = format!("{HEAD}DATA binary\n").into_bytes();
    binary.extend(numbers().iter().chain(&[1.0; 6]).flat_map(|x| x.to_le_bytes()));
    for (bytes, said) in [(ascii.as_bytes(), "1 lines"), (&binary, "24 bytes")] {
        let file = parse(Path::new("a.pcd"), bytes).unwrap();
        assert_eq!(file.cloud.len(), 2);
        assert!(file.notes[0].contains(said), "{:?}", file.notes);
    }
}

#[test]
fn compressed_fields_stand_one_after_the_other() {
    let head = HEAD
        .replace("SIZE 4 4 4", "SIZE 2 4 4")
        .replace("TYPE F F", "TYPE I F")
        .replace("VIEWPOINT 1 2 3", "VIEWPOINT 0 0 0");
    let mut plain: Vec<u8> = [-5i16, 6].iter().flat_map(|x| x.to_le_bytes()).collect();
    plain.extend((0..10).flat_map(|i| (i as f32).to_le_bytes()));
    let mut block: Vec<u8> = plain.chunks(32).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect();
    let sizes = [(block.len() as u32).to_le_bytes(), (plain.len() as u32).to_le_bytes()].concat();
    block.splice(0..0, sizes);
    let file =
        |block: &[u8]| parse(Path::new("a.pcd"), &[head.as_bytes(), b"DATA binary_compressed\n", block].concat());
    let cloud = file(&block).unwrap().cloud;
    assert_eq!(cloud.points[0].coords, nalgebra::Vector3::new(-5.0, 0.0, 2.0));
    assert_eq!(cloud.points[1].coords, nalgebra::Vector3::new(6.0, 1.0, 3.0));
    assert_eq!(cloud.normals[1], nalgebra::Vector3::new(5.0, 7.0, 9.0));
    block[8] = 255;
    assert!(file(&block).expect_err("damaged").to_string().contains("compressed block"));
}

#[test]
fn a_small_file_does_not_become_gigabytes() {
    let points = 28_000_000u32;
    let head =
        format!("FIELDS x y z\nSIZE 1 1 1\nTYPE U U U\nWIDTH {points}\nPOINTS {points}\nDATA binary_compressed\n");
    let packed = 1_000_000u32;
    let sizes = [packed.to_le_bytes(), (3 * points).to_le_bytes()].concat();
    let bytes = [head.as_bytes(), &sizes, &vec![0; packed as usize]].concat();
    let text = parse(Path::new("a.pcd"), &bytes).expect_err("large").to_string();
    assert!(
        text.contains(
            "28000000 points would take 2002 MiB of memory, but a file of this size may take at most 286 MiB"
        ),
        "{text}"
    );
}

#[test]
fn a_header_that_contradicts_itself_is_refused_or_said() {
    let ascii = format!("{HEAD}DATA ascii\n0 1 2 3 4 5\n6 7 8 9 10 11\n");
    for line in ["WIDTH 2", "HEIGHT 1", "POINTS 2", "VIEWPOINT 1 2 3 1 0 0 0", "COLUMNS x y z nx ny nz"] {
        let twice = ascii.replace("DATA", &format!("{line}\nDATA"));
        let error = parse(Path::new("a.pcd"), twice.as_bytes()).expect_err(line).to_string();
        assert!(error.contains("every line of the header once"), "{line}: {error}");
    }
    let read = |from: &str, to: &str| parse(Path::new("a.pcd"), ascii.replace(from, to).as_bytes()).unwrap();
    let file = read("WIDTH 2", "WIDTH 7");
    assert_eq!((file.cloud.len(), file.grid.is_some()), (2, false));
    assert!(file.notes[0].contains("WIDTH 7 and HEIGHT 1 are not POINTS 2"), "{:?}", file.notes);
    for none in ["nan 2 3 1 0 0 0", "1 2 3 0 0 0 0", "inf 0 0 1 0 0 0"] {
        let file = read("1 2 3 1 0 0 0", none);
        assert_eq!(file.viewpoint, None);
        assert!(file.notes[0].contains(&format!("VIEWPOINT {none} is no pose")), "{:?}", file.notes);
    }
    let usual = read("1 2 3 1 0 0 0", "0 0 0 1 0 0 0");
    assert_eq!((usual.viewpoint, usual.notes.len()), (None, 0), "what writers put who know nothing");
}

#[test]
fn binary_points_sent_as_text_are_refused() {
    let head = format!("{HEAD}DATA binary\n").replace("WIDTH 2", "WIDTH 40").replace("POINTS 2", "POINTS 40");
    let body: Vec<u8> = (0..240).flat_map(|i| (i as f32 + 0.1).to_le_bytes()).chain([b'\n'; 3]).collect();
    let body = &body[..960];
    let mangled: Vec<u8> = body.iter().flat_map(|b| if *b == b'\n' { vec![b'\r', b'\n'] } else { vec![*b] }).collect();
    let read = |body: &[u8]| parse(Path::new("a.pcd"), &[head.as_bytes(), body].concat());
    assert_eq!(read(body).unwrap().cloud.len(), 40);
    match mangled.len() > body.len() {
        true => {
            let error = read(&mangled).expect_err("shifted").to_string();
            assert!(error.contains("carriage return before every line feed") && error.contains("FTP"), "{error}");
        }
        false => panic!("the data hold a line feed"),
    }
}
