use super::*;

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
        ("Point ID,X,Y,Z", [1, 2, 3], None),
        ("Scan Nr;X mm;Y mm;Z mm;Colour of it", [1, 2, 3], Some(0.001)),
        ("X Coordinate\tY Coordinate\tZ Coordinate", [0, 1, 2], None),
        ("R G B, X Y Z", [3, 4, 5], None),
        ("x y z\t", [0, 1, 2], None),
        ("x [\u{b5}m],y [\u{3bc}m],z [\u{fffd}m]", [0, 1, 2], Some(1e-6)),
        ("x_nm y_nm z_nm", [0, 1, 2], Some(1e-9)),
        ("X (yd);Y (yd);Z (yd)", [0, 1, 2], Some(0.9144)),
        ("Easting (UTM) [m]\tNorthing (UTM) [m]\tHeight (UTM) [m]", [0, 1, 2], Some(1.0)),
        ("x [],y [1],z [-]", [0, 1, 2], None),
        ("X axis [um],Y axis [um],Z axis [um]", [0, 1, 2], Some(1e-6)),
        ("X-Achse [\u{fffd}m];Y-Achse [\u{fffd}m];Z-Achse [\u{fffd}m]", [0, 1, 2], Some(1e-6)),
        ("id,X in mm,Y in mm,Z in mm", [1, 2, 3], Some(0.001)),
        ("x in [mm],y in [mm],z in [mm]", [0, 1, 2], Some(0.001)),
        ("x in,y in,z in", [0, 1, 2], Some(0.0254)),
        ("X value\tY value\tZ value", [0, 1, 2], None),
    ] {
        let columns = Columns::named(line).expect(line).expect(line);
        assert_eq!((columns.position, columns.metres_per_unit), (position, unit), "{line}");
    }
    assert_eq!(Columns::named("nx ny nz x y z").unwrap().unwrap().normal, Some([0, 1, 2]));
    for (line, unit) in [("x [px],y [px],z [px]", "px"), ("X (Image mm),Y (Image mm),Z (Image mm)", "image mm")] {
        let columns = Columns::named(line).unwrap().unwrap();
        assert_eq!((columns.metres_per_unit, columns.unknown_unit.as_deref()), (None, Some(unit)));
    }
    for line in ["lat,lon,alt", "a b c", "x,y", "scan of a vase"] {
        assert_eq!(Columns::named(line), Ok(None), "{line}");
    }
    assert!(Columns::named("x,y,z,x").expect_err("twice").contains("\"x\" twice"));
    assert!(Columns::named("x [mm],y [m],z [mm]").expect_err("units").contains("different units"));
}

#[test]
fn cells_may_be_empty_between_marks_alone() {
    let cells = |line, commas_part| cells(line, commas_part, true);
    assert_eq!(cells("1,,3", true), ["1", "", "3"]);
    assert_eq!(cells(" 1  2 ; 3\t4,5 , 6 ", true), ["1", "2", "3", "4", "5", "6"]);
    assert_eq!(cells("0,1 0,2;0,3", false), ["0,1", "0,2", "0,3"]);
    assert_eq!(cells("1,2,,", true), ["1", "2", "", ""]);
    assert_eq!(cells(";1;2", true), ["", "1", "2"]);
    assert_eq!(cells("\"0,5\",\"a b\", 2", true), ["0,5", "a b", "2"]);
    assert!(cells("  ", true).is_empty());
}

#[test]
fn blanks_belong_to_cells_between_marks() {
    let cells = |line| cells(line, true, false);
    assert_eq!(cells("red car,1, 2 ,3"), ["red car", "1", "2", "3"]);
    assert_eq!(cells("a  b\t\t 3"), ["a  b", "", "3"]);
    assert!(has_marks("a b,c", true) && !has_marks("a 0,5", false) && !has_marks("a b\t", true));
}
