use super::*;

fn named(line: &str) -> Result<Option<Columns>, String> {
    let names = names(line);
    Columns::named(&names.iter().map(String::as_str).collect::<Vec<_>>())
}

#[test]
fn names_in_all_spellings() {
    for (line, position, unit) in [
        ("x,y,z", [0, 1, 2], None),
        ("GPSTime,X,Y,Z,Intensity", [1, 2, 3], None),
        ("z;y;x", [2, 1, 0], None),
        ("\"id\",\"pos_x\",\"pos_y\",\"pos_z\"", [1, 2, 3], None),
        ("Easting [m]\tNorthing [m]\tHeight [m]", [0, 1, 2], Some(1.0)),
        ("//X Y Z R G B", [0, 1, 2], None),
        ("R X [mm] Y [mm] Z [mm]", [1, 2, 3], Some(0.001)),
        ("nx ny nz x(cm) y(cm) z(cm)", [3, 4, 5], Some(0.01)),
        ("Points:2,Points:0,Points:1", [1, 2, 0], None),
        ("x_mm,y_mm,z_mm", [0, 1, 2], Some(0.001)),
        ("point,E,N,H", [1, 2, 3], None),
        (",x,y,z", [1, 2, 3], None),
    ] {
        let columns = named(line).expect(line).expect(line);
        assert_eq!((columns.position, columns.metres_per_unit), (position, unit), "{line}");
    }
    assert_eq!(named("nx ny nz x y z").unwrap().unwrap().normal, Some([0, 1, 2]));
    for line in ["lat,lon,alt", "a b c", "x,y", "scan of a vase"] {
        assert_eq!(named(line), Ok(None), "{line}");
    }
    assert!(named("x,y,z,x").expect_err("twice").contains("\"x\" twice"));
    assert!(named("x [mm],y [m],z [mm]").expect_err("units").contains("different units"));
}

#[test]
fn cells_may_be_empty_between_marks_alone() {
    assert_eq!(cells("1,,3", true), ["1", "", "3"]);
    assert_eq!(cells(" 1  2 ; 3\t4,5 , 6 ", true), ["1", "2", "3", "4", "5", "6"]);
    assert_eq!(cells("0,1 0,2;0,3", false), ["0,1", "0,2", "0,3"]);
    assert_eq!(cells("1,2,,", true), ["1", "2", "", ""]);
    assert_eq!(cells(";1;2", true), ["", "1", "2"]);
    assert_eq!(cells("\"0,5\",\"a b\", 2", true), ["0,5", "a b", "2"]);
    assert!(cells("  ", true).is_empty());
}
