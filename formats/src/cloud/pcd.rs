//! PCD: text, binary and compressed; `pcd-rs` parses, after its sizes are checked: it allocates what the header
//! and the two sizes of a compressed block claim.

use super::CloudFile;
use crate::FormatError;
use crate::error::Place;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use pcd_rs::{DataKind, DynReader, DynRecord, Field, PcdMeta};
use std::io::Cursor;
use std::path::Path;

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let mut cursor = Cursor::new(bytes);
    let meta = PcdMeta::from_reader(&mut cursor).map_err(|e| {
        FormatError::syntax(path, Place::Part("header".to_owned()), e.to_string(), "a PCD header of version 0.5 to 0.7")
    })?;
    if meta.num_points == 0 {
        return CloudFile::gather(path, std::iter::empty(), None);
    }
    check_sizes(path, &meta, &bytes[cursor.position() as usize..])?;

    let place = |i: usize| match meta.data {
        DataKind::Ascii => {
            let header = bytes[..cursor.position() as usize].iter().filter(|&&b| b == b'\n').count();
            Place::Line(header + i + 1)
        }
        _ => Place::Part(format!("point {i}")),
    };
    let fields: Vec<&str> = meta.field_defs.iter().filter(|f| !f.is_padding()).map(|f| f.name.as_str()).collect();
    let find = |names: [&str; 3]| {
        let mut at = [0; 3];
        for (slot, name) in at.iter_mut().zip(names) {
            *slot = fields.iter().position(|f| f.eq_ignore_ascii_case(name))?;
        }
        Some(at)
    };
    let Some(xyz) = find(["x", "y", "z"]) else {
        let part = Place::Part("FIELDS".to_owned());
        return Err(FormatError::syntax(path, part, fields.join(" "), "x y z among them"));
    };
    let normal = find(["normal_x", "normal_y", "normal_z"]).or_else(|| find(["nx", "ny", "nz"]));

    let block = |e: pcd_rs::Error| {
        FormatError::syntax(path, Place::Byte(cursor.position()), e.to_string(), "a compressed block")
    };
    let reader = DynReader::from_reader(Cursor::new(bytes)).map_err(block)?;
    let mut rows = vec![];
    for (i, record) in reader.enumerate() {
        let expected = || format!("point {i} of {} with the fields {}", meta.num_points, fields.join(" "));
        let record = record.map_err(|e| FormatError::syntax(path, place(i), e.to_string(), expected()))?;
        let position = values(&record, xyz).ok_or_else(|| {
            FormatError::syntax(path, place(i), "a field x, y or z with a COUNT above 1", "one number")
        })?;
        rows.push((position, normal.and_then(|at| values(&record, at))));
    }
    let organised = meta.height > 1 && meta.width.checked_mul(meta.height) == Some(rows.len() as u64);
    let size = organised.then_some((meta.width as usize, meta.height as usize));
    let mut file = CloudFile::gather(path, rows.into_iter(), size)?;
    let v = &meta.viewpoint;
    let pose = UnitQuaternion::try_new(Quaternion::new(v.qw, v.qx, v.qy, v.qz), 1e-9)
        .map(|rotation| Isometry3::from_parts(Translation3::new(v.tx, v.ty, v.tz), rotation));
    file.viewpoint = pose.filter(|p| p.translation.vector.iter().all(|x| x.is_finite()) && *p != Isometry3::identity());
    Ok(file)
}

fn check_sizes(path: &Path, meta: &PcdMeta, body: &[u8]) -> Result<(), FormatError> {
    let room = body.len() as u64;
    let count = |what: &str, found: u64, most: u64| {
        let place = Place::Part("header".to_owned());
        Err(FormatError::Count { path: path.to_owned(), place, what: what.to_owned(), found, most })
    };
    // A factor of 90 bounds what an LZF block can grow to (264 bytes from 3).
    let limit = if meta.data == DataKind::BinaryCompressed { room.saturating_mul(90) } else { room };
    let numbers = meta.field_defs.iter().try_fold(0u64, |n, f| n.checked_add(f.count)).unwrap_or(u64::MAX);
    if numbers > limit {
        return count("numbers per point", numbers, limit);
    }
    let record: u64 = meta.field_defs.iter().map(|f| f.kind.byte_size() as u64 * f.count).sum();
    let least = if meta.data == DataKind::Ascii { numbers * 2 } else { record }; // a digit and a blank
    let most = (limit + 1) / least.max(1);
    if meta.num_points > most {
        return count("points", meta.num_points, most);
    }
    if meta.data == DataKind::BinaryCompressed {
        let size = |at: usize| body.get(at..at + 4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
            return Err(FormatError::truncated(path, Place::File, "the two sizes of a compressed block"));
        };
        if packed > room - 8 {
            return count("compressed bytes", packed, room - 8);
        }
        if unpacked != record * meta.num_points || (unpacked > 0) != (packed > 0) || unpacked > packed * 90 {
            let place = Place::Part("compressed block".to_owned());
            let found = format!("{packed} bytes that become {unpacked}");
            let expected = format!("{} bytes for {} points", record * meta.num_points, meta.num_points);
            return Err(FormatError::syntax(path, place, found, expected));
        }
    }
    Ok(())
}

fn values(record: &DynRecord, at: [usize; 3]) -> Option<[f64; 3]> {
    let mut out = [0.0; 3];
    for (value, index) in out.iter_mut().zip(at) {
        *value = match record.0.get(index)? {
            Field::F32(v) => f64::from(*v.first()?),
            Field::F64(v) => *v.first()?,
            Field::I8(v) => f64::from(*v.first()?),
            Field::I16(v) => f64::from(*v.first()?),
            Field::I32(v) => f64::from(*v.first()?),
            Field::I64(v) => *v.first()? as f64,
            Field::U8(v) => f64::from(*v.first()?),
            Field::U16(v) => f64::from(*v.first()?),
            Field::U32(v) => f64::from(*v.first()?),
            Field::U64(v) => *v.first()? as f64,
        };
    }
    Some(out)
}

#[cfg(test)]
mod tests {
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
}
