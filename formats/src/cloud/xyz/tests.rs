use super::*;

fn read(text: &str) -> Result<CloudFile, FormatError> {
    parse(Path::new("a.xyz"), text.as_bytes())
}

#[test]
fn columns_and_separators() {
    for text in [
        "1 2 3\n4 5 6",
        "x,y,z\n1,2,3\n4,5,6\n",
        "2\n\n1\t2;3 # c\n// c\n4 5 6 label",
        "1 2 3 255 0 0\r\n4 5 6 9 9 9\r\n",
    ] {
        let file = read(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        assert_eq!((file.cloud.len(), file.cloud.has_normals()), (2, false), "{text:?}");
        assert_eq!(file.cloud.points[1].z, 6.0, "{text:?}");
    }
    let file = read("1 2 3 0 0 1\nnan nan nan nan nan nan\n4 5 6 0.6 0.8 0").unwrap();
    assert_eq!((file.cloud.len(), file.cloud.normals.len(), file.dropped), (2, 2, 1));
    assert_eq!(read("5600000.25 1 1").unwrap().cloud.points[0].x, 5_600_000.25, "survey coordinates keep their digits");
}

#[test]
fn errors_name_line_found_and_expected() {
    let text = |t: &str| read(t).expect_err(t).to_string();
    assert!(text("1 2 3\n4 five 6").contains("line 2: found \"five\", expected three coordinates"));
    assert!(text("1 2 3\n4 5").contains("line 2: found 2 numbers"));
    assert!(text("a b c\nd e f").contains("line 2"));
    assert!(text("").contains("found 0 points"));
    assert!(text("nan nan nan").contains("found 1 points, none with finite"));
}

#[test]
fn names_say_which_columns_are_read() {
    for text in [
        "GPSTime,X,Y,Z\n7,1,2,3\n8,4,5,6\n",
        "z y x\n3 2 1\n6 5 4\n",
        "# id x y z\n1 1 2 3\n2 4 5 6\n",
        "//X Y Z Intensity\n1 2 3 9\n4 5 6 9\n",
        "label;x;y;z\n\"a b\";1;2;3\nc;4;5;6\n",
        "Easting [m]\tNorthing [m]\tHeight [m]\n1\t2\t3\n4\t5\t6\n",
        ",x,y,z\n0,1,2,3\n1,4,5,6\n",
        "2\nx y z\n1 2 3\n4 5 6\n",
        "Point ID,X,Y,Z\n7,1,2,3\n8,4,5,6\n",
        "Name of it;x;y;z;colour\nred car;1;2;3;dark red\n;4;5;6;\n",
        "label\tx\ty\tz\nred car\t1\t2\t3\na b c\t4\t5\t6\n",
        "# x, y, z\n1 2 3\n4 5 6\n",
        "x,y,z\n1 2 3\n4 5 6\n",
        "# Point ID, x, y, z\n7, 1, 2, 3\n8, 4, 5, 6\n",
        "% made by hand\n% x y z\n1 2 3 9\n % half of it\n4 5 6 9\n",
        "% id x y z\n1 1 2 3\n2 4 5 6\n",
    ] {
        let file = read(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        let points: Vec<_> = file.cloud.points.iter().map(|p| [p.x, p.y, p.z]).collect();
        assert_eq!(points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "{text:?}");
        assert_eq!(file.notes, Vec::<String>::new(), "{text:?}");
    }
    let file = read("nx,ny,nz,x,y,z\n0,0,1,1,2,3\n0,0,1,4,5,6\n,,,7,8,9").unwrap();
    assert_eq!((file.cloud.points[1].x, file.cloud.normals[1].z, file.cloud.normals[2].z), (4.0, 1.0, 0.0));
    assert_eq!(read("x [mm],y [mm],z [mm]\n1,2,3\n").unwrap().metres_per_unit, Some(0.001));
    let notes = read("scan of a vase\n1 2 3\n4 5 6\n").unwrap().notes;
    assert!(notes[0].contains("line 1, \"scan of a vase\""), "{notes:?}");
}

#[test]
fn decimal_commas_are_read_or_refused() {
    for text in [
        "0,125 -2,5 1e-3\n0 0,5 1,0",
        "x;y;z\n0,125;-2,5;1e-3\n0;0,5;1,0",
        "\"0,125\",\"-2,5\",1e-3\n\"0\",\"0,5\",\"1,0\"",
    ] {
        let file = read(text).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        assert_eq!(file.cloud.points[0].coords, nalgebra::Vector3::new(0.125, -2.5, 0.001), "{text:?}");
        assert_eq!(file.cloud.points[1].y, 0.5, "{text:?}");
    }
    assert!(read("0,5 0,25 1,0\n").unwrap().notes[0].contains("decimal separators"));
    let error = |t: &str| read(t).expect_err(t).to_string();
    assert!(error("-0,000010,-0,007477,0,105884\n").contains("line 1: found \"000010\""));
    assert!(error("x,y,z\n0,5,0,25,1,5\n").contains("line 2: found 6 values, expected 3, as line 1 names columns"));
    assert!(error("1,234.5 2,345.6 3,456.7\n").contains("thousands"));
    assert!(error("0,5 0,25 1,0\n0,5 1.000,5 1,0\n").contains("line 2"));
}

#[test]
fn missing_values_are_refused_with_their_line() {
    let error = |t: &str| read(t).expect_err(t).to_string();
    assert!(error("x,y,z,i\n1,2,3,5\n1,,3,5\n").contains("line 3: found an empty cell in column 2"));
    assert!(error("Point ID,X,Y,Z\nred car,1,2\n").contains("line 2: found 3 values, expected 4, as line 1 names"));
    assert!(error("Point ID,lat,lon,alt\nred car,1,2,3\n").contains("line 1: found \"Point ID,lat,lon,alt\""));
    assert!(error("lat,lon,alt\n1,2,3\n").contains("line 1: found \"lat,lon,alt\", expected x, y and z"));
    assert!(error("1\t2\t3\n1\t\t3\n").contains("line 2: found an empty cell in column 2"));
    assert!(error("1 2 3 4\n1 3 4\n").contains("line 2: found 3 numbers, expected 4, as in the lines before"));
    assert!(error("x y z\n\"1\" 1 2 3\n").contains("line 2: found 4 values, expected 3"));
    assert!(error("x,y,z,x\n1,2,3,4\n").contains("line 1: found the column \"x\" twice"));
    assert!(error("x,y,z,i\n1,2,3\n").contains("line 2: found 3 values, expected 4"));
    for text in ["x,y,z,i\n1,2,3,\n4,5,6,7\n", "x,y,z\n1,2,3,\n4,5,6,\n", "1,2,3,,\n4,5,6,,\n"] {
        assert_eq!(read(text).unwrap().cloud.len(), 2, "{text:?}: nothing of a position is missing");
    }
}

#[test]
fn counts_and_colours_are_said() {
    assert!(read("1 2 3\nn/a 5 6\n").unwrap().notes[0].contains("1 points have a non-finite coordinate"));
    let notes = |t: &str| read(t).unwrap_or_else(|e| panic!("{t:?}: {e}")).notes;
    assert!(notes("3\n1 2 3\n4 5 6\n")[0].contains("says 3, but there are 2"));
    assert!(notes("2\n1 2 3\n4 5 6\n").is_empty());
    assert!(notes("1 2 3 1 0 0\n4 5 6 1 0 0\n")[0].contains("columns 4 to 6"), "one colour for all");
    assert!(notes("1 2 3 0.2 0.3 0.4\n4 5 6 0 0 1\n")[0].contains("columns 4 to 6"));
    assert!(notes("1 2 3 1.#IND 0 0\n1 2 4 1 0 0\n")[0].contains("columns 4 to 6"));
}

#[test]
fn numbers_of_points_are_said_and_excels_first_line_is_none() {
    let rows = |first: usize| (first..first + 12).map(|i| format!("{i} 0.5 0.25 {}\n", i * i)).collect::<String>();
    for first in [0, 1] {
        assert!(read(&rows(first)).unwrap().notes[0].contains("column 1 counts the lines"), "from {first}");
    }
    assert!(
        read(&rows(2)).unwrap().notes.is_empty()
            && read(&rows(1).replace("11 0.5", "11.5 0.5")).unwrap().notes.is_empty()
    );
    assert!(read(&format!("x y z i\n{}", rows(1))).unwrap().notes.is_empty(), "by name");
    let file = read("sep=;\nx;y;z\n0,5;1,5;2\n").unwrap();
    assert_eq!(file.cloud.points, [nalgebra::Point3::new(0.5, 1.5, 2.0)]);
}

#[test]
fn units_are_read_in_any_encoding_and_unknown_ones_told() {
    for bytes in
        [&b"x [\xb5m],y [\xb5m],z [\xb5m]\n1,2,3\n"[..], "x [\u{b5}m],y [\u{b5}m],z [\u{b5}m]\n1,2,3\n".as_bytes()]
    {
        let file = parse(Path::new("a.csv"), bytes).unwrap();
        assert_eq!((file.metres_per_unit, file.unknown_unit), (Some(1e-6), None));
    }
    let file = read("x [px],y [px],z [px]\n1,2,3\n").unwrap();
    assert_eq!((file.metres_per_unit, file.unknown_unit.as_deref()), (None, Some("px")));
}

#[test]
fn names_of_several_words_stay_together() {
    let file = read("X axis [mm],Y axis [mm],Z axis [mm]\n1,2,3\n").unwrap();
    assert_eq!((file.cloud.points[0].z, file.metres_per_unit, file.notes.len()), (3.0, Some(0.001), 0));
    let error = read("X left [mm],Y left [mm],Z left [mm]\n1,2,3\n").expect_err("which x?").to_string();
    assert!(error.contains("line 1: found \"X left [mm],Y left [mm],Z left [mm]\", expected x, y and z"), "{error}");
    // Blanks part names where they part as many numbers.
    let file = read("R G B, X Y Z\n9 9 9, 1 2 3\n").unwrap();
    assert_eq!((file.cloud.points[0].x, file.notes.len()), (1.0, 0));
}
