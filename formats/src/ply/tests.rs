use super::*;
use geometry::PointCloud;
use nalgebra::{Point3, Vector3};

fn mesh(text: &str) -> Result<Mesh, FormatError> {
    parse_mesh(Path::new("a.ply"), text.as_bytes())
}

const HEAD: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float y\nproperty float x\nproperty double z\n";

#[test]
fn any_order_of_properties_and_extra_elements() {
    let text = format!(
        "{HEAD}property list uchar int other\nelement face 1\nproperty uchar red\nproperty list uchar short vertex_index\n\
         element range_grid 2\nproperty list uchar int vertex_indices\nend_header\n\
         0 1 0 2 5 5\n0 0 0 0\n1 0 0 0\n9 3 0 1 2\n1 2\n0\n"
    );
    let mesh = mesh(&text).unwrap();
    assert_eq!(mesh.vertices[0], Point3::new(1.0, 0.0, 0.0));
    assert_eq!(mesh.area(), 0.5);
}

#[test]
fn errors_name_place_found_and_expected() {
    let text = |t: &str| mesh(t).expect_err(t).to_string();
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n";
    assert!(text(&format!("{HEAD}{faces}{rows}3 0 1 3\n")).contains("face 0: found vertex index 3, expected one of 3"));
    let message = text(&format!("{HEAD}{faces}0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n"));
    assert!(message.contains("line 11") && message.contains("zero"), "{message}");
    let message = text(&format!("{HEAD}{faces}0 0 0\n"));
    assert!(message.contains("declared") || message.contains("ends here"), "{message}");
    let huge = HEAD.replace("vertex 3", "vertex 1000000000000");
    assert!(text(&format!("{huge}{faces}{rows}")).contains("1000000000000 rows of element \"vertex\" declared"));
    let bare = "ply\nformat binary_little_endian 1.0\nelement nothing 1000000000\nend_header\n";
    assert!(text(bare).contains("1000000000 rows of element \"nothing\" declared"));
    assert!(text("ply\nformat ascii 1.0\nend_header\n").contains("found no element"));
    assert!(text("plx\n").contains("PLY header"));
}

fn cloud(text: &str) -> CloudFile {
    parse_cloud(Path::new("a.ply"), text.as_bytes()).unwrap_or_else(|e| panic!("{text}: {e}"))
}

#[test]
fn numbers_lines_and_names_of_the_field() {
    let head = HEAD.replace("float x", "float X") + "property float scalar_Roughness_(0.05)\nend_header\n";
    let rows = ".5 -.25 1. 0\n\nnan nan nan 1\n1 2 -1.#IND 7\n";
    for text in [format!("{head}{rows}"), format!("{head}{rows}").replace('\n', "\r"), format!("\u{feff}{head}{rows}")]
    {
        let file = cloud(&text);
        assert_eq!((file.cloud.points[0], file.dropped), (Point3::new(-0.25, 0.5, 1.0), 2), "{text:?}");
        assert_eq!(file.notes.len(), 1, "{:?}", file.notes);
    }
}

#[test]
fn binary_of_either_order_with_wide_integers_and_lists() {
    let head = |order: &str| {
        format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 3\nproperty float x\nproperty int64 t\n\
             property short y\nproperty double z\nelement face 1\nproperty list ushort uint64 vertex_index\nend_header\n"
        )
    };
    let (mut little, mut big) = (head("little").into_bytes(), head("big").into_bytes());
    for (x, y, z) in [(0f32, 0i16, 0f64), (2.0, 0, 0.0), (0.0, -2, 0.0)] {
        little.extend([&x.to_le_bytes()[..], &9i64.to_le_bytes(), &y.to_le_bytes(), &z.to_le_bytes()].concat());
        big.extend([&x.to_be_bytes()[..], &9i64.to_be_bytes(), &y.to_be_bytes(), &z.to_be_bytes()].concat());
    }
    little.extend([3, 0]);
    big.extend([0, 3]);
    for i in 0..3u64 {
        little.extend(i.to_le_bytes());
        big.extend(i.to_be_bytes());
    }
    for mut bytes in [little, big] {
        assert_eq!(parse_mesh(Path::new("a.ply"), &bytes).unwrap().area(), 2.0);
        bytes.pop();
        let text = parse_mesh(Path::new("a.ply"), &bytes).expect_err("cut off").to_string();
        assert!(text.contains("the file ends here, expected row 0 of 1 of element \"face\""), "{text}");
    }
}

#[test]
fn strips_are_triangles_in_turn() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n\
                8 0 1 2 3 -1 2 1 0\n";
    let mesh = mesh(text).unwrap();
    let up = |t: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*t);
        (b - a).cross(&(c - a)).z
    };
    assert_eq!(mesh.triangles.iter().map(up).collect::<Vec<_>>(), [1.0, 1.0, -1.0]);
}

#[test]
fn faces_behind_strips_are_polygons() {
    let list = "property list int int vertex_indices\n";
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\nproperty float z\n\
         element tristrips 1\n{list}element face 1\n{list}end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
         3 0 1 2\n4 3 4 5 6\n"
    );
    let mesh = mesh(&text).unwrap();
    let up = |t: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*t);
        (b - a).cross(&(c - a)).z
    };
    assert_eq!(mesh.triangles.iter().map(up).collect::<Vec<_>>(), [1.0, 1.0, 1.0]);
}

#[test]
fn what_follows_the_declared_rows_is_said() {
    let rows = "0 0 0\n1 0 0\n0 1 0\n";
    let file = cloud(&format!("{HEAD}end_header\n{rows}5 5 5\n6 6 6\n"));
    assert_eq!(file.cloud.len(), 3);
    assert!(file.notes[0].contains("2 lines follow after the rows that the header declares"), "{:?}", file.notes);
    assert!(cloud(&format!("{HEAD}end_header\n{}", rows.replace("1 0 0", "1 0 0 9"))).notes[0].contains("line 9"));
    let binary = HEAD.replace("ascii", "binary_little_endian").replace("vertex 3", "vertex 1") + "end_header\n";
    let text = binary + &"\u{1}".repeat(16 + 5);
    assert!(cloud(&text).notes[0].contains("5 bytes follow"));
}

#[test]
fn what_is_written_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    let mut cloud = PointCloud {
        points: vec![Point3::new(5_600_000.123, 0.1, -3.0), Point3::new(1.0 / 3.0, 0.0, 1e-9)],
        normals: vec![Vector3::z(), Vector3::new(0.5, 0.5, 0.1)],
    };
    write_ply(&path, &cloud).unwrap();
    assert_eq!(crate::cloud::read_cloud(&path).unwrap().cloud, cloud);
    cloud.normals.clear();
    write_ply(&path, &cloud).unwrap();
    assert_eq!(crate::cloud::read_cloud(&path).unwrap().cloud, cloud);

    let points = [ColoredPoint { position: cloud.points[0], color: [1, 2, 3] }; 2];
    write_ply_scene(&path, &points, &[[0, 1]]).unwrap();
    assert_eq!(crate::cloud::read_cloud(&path).unwrap().cloud.len(), 2);
}

#[test]
fn binary_rows_sent_as_text_are_refused() {
    let head = HEAD.replace("ascii", "binary_little_endian").replace("vertex 3", "vertex 9") + "end_header\n";
    let body: Vec<u8> =
        (0..9u8).flat_map(|i| [[10, i, 0, 0], [i, 1, 10, 0x3f], [0; 4], [0, 10, i, 0x40]].concat()).collect();
    let pairs = |bytes: &[u8]| -> Vec<u8> {
        bytes.iter().flat_map(|b| if *b == b'\n' { vec![b'\r', b'\n'] } else { vec![*b] }).collect()
    };
    let read = |body: &[u8]| parse_cloud(Path::new("a.ply"), &[&pairs(head.as_bytes()), body].concat());
    assert_eq!(read(&body).unwrap().cloud.len(), 9, "a header with any line ends");
    let error = read(&pairs(&body)).expect_err("shifted").to_string();
    assert!(error.contains("a.ply\", binary rows: found a carriage return before every line feed"), "{error}");
}

#[test]
fn the_only_list_of_integers_makes_the_faces_whatever_its_name() {
    let text =
        |lists: &str, row: &str| format!("{HEAD}element face 1\n{lists}end_header\n0 0 0\n1 0 0\n0 1 0\n{row}\n");
    let one = text("property list uchar float uv\nproperty list uchar int vertex_ids\n", "1 0.5 3 0 1 2");
    let content = parse(Path::new("a.ply"), one.as_bytes(), true).unwrap();
    assert_eq!((&content.corners[..], &content.ends[..]), (&[0, 1, 2][..], &[3][..]));
    assert!(content.notes[0].contains("\"vertex_ids\", the only list of integers"), "{:?}", content.notes);
    let two = text("property list uchar int a\nproperty list uchar int b\n", "1 0 3 0 1 2");
    let message = mesh(&two).expect_err("which?").to_string();
    assert!(message.contains("0 faces"), "{message}");
}
