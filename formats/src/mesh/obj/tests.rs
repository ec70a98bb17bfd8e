use super::*;

fn read(text: &str) -> Result<Mesh, FormatError> {
    parse(Path::new("a.obj"), text.as_bytes())
}

#[test]
fn vertices_are_the_distinct_corners_that_faces_use() {
    let quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nvn 0 0 1\nvn 0 0 1\nvn 1 0 0\n";
    let corners = |faces: &str| read(&format!("{quad}{faces}")).unwrap().vertices.len();
    assert_eq!(corners("f 1 2 3 4"), 4, "the unused vertex does not count");
    assert_eq!(corners("f 1//1 2//1 3//1\nf 1//2 3//2 4//2"), 4, "equal normals make one corner");
    assert_eq!(corners("f 1//1 2//1 3//1\nf 1//3 3//3 4//3"), 6, "other normals make other corners");
    assert_eq!(corners("f 1//1 2 3\nf -5/1 -3/2 -2/3"), 5, "with and without a normal");
    assert_eq!(corners("g a f 1 2 3\no f\nusemtl none\nl 1 2\nf 1 2\nf 1\\\n 2 3 # end"), 3);
}

#[test]
fn normals_that_are_not_there_leave_the_surface() {
    let triangle = "v 0 0 0\nv 2 0 0\nv 0 2 0\n";
    for faces in ["f 1//1 2//2 3//3", "vn 0 0 1\nf 1//1 2//6148914691236517207 3//1", "f 1//-4 2//-4 3//-4"] {
        let mesh = read(&format!("{triangle}{faces}")).unwrap_or_else(|e| panic!("{faces}: {e}"));
        assert_eq!((mesh.vertices.len(), mesh.area()), (3, 2.0), "{faces}");
    }
}

#[test]
fn marks_and_line_ends_of_any_system() {
    let text = "# made by hand\nv 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n";
    for bytes in [text.replace('\n', "\r"), text.replace('\n', "\r\n"), format!("\u{feff}{}", &text[15..])] {
        assert_eq!(read(&bytes).unwrap().area(), 2.0, "{bytes:?}");
    }
}

#[test]
fn errors_name_line_found_and_expected() {
    let text = |t: &str| read(t).expect_err(t).to_string();
    assert!(text("v 1 2\n").contains("line 1: found too few numbers, expected three coordinates"));
    assert!(text("v 1 2 3\nf 1 2 3").contains("line 2: found vertex index 2, expected one of 1"));
    assert!(text("v 1 2 3\nf 0 1 1").contains("line 2: found \"0\""));
    assert!(text("v 1 2 3\nf -2 1 1").contains("vertex index -2"));
    assert!(text("v 1 2 3\nf 1//x 1 1").contains("line 2: found \"1//x\""));
    assert!(text("v 1 2 3\nf 1/2/3/4 1 1").contains("corner"));
    assert!(text("# nothing").contains("found 0 vertices and 0 faces"));
    assert!(text("v 0 0 0\nv 0 0 0\nv 1 0 0\nf 1 2 3").contains("without area"));
}

#[test]
fn lines_go_on_behind_a_backslash_unless_the_file_ends() {
    for faces in ["f 1 \\\n2 \\\n3", "f 1 2 3 \\", "f 1 2 \\\n3 \\\n"] {
        let mesh = read(&format!("v 0 0 0\nv 2 0 0\nv 0 2 0\n{faces}")).unwrap_or_else(|e| panic!("{faces:?}: {e}"));
        assert_eq!(mesh.area(), 2.0, "{faces:?}");
    }
}
