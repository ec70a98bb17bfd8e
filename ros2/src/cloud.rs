//! `PointCloud2` as a request: the points in the base frame as a binary PCD, which has the same layout and, for organised clouds,
//! the grid and the sensor's pose that make them depth images.

use crate::MessageError;
use crate::messages::{PointCloud2, PointField};
use crate::planner::{MadeOf, ScanRequest};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::{Isometry3, Point3, Vector3};
use serde_json::json;

const NAME: &str = "PointCloud2";
/// Nearer than this to the base frame, four bytes hold a coordinate to half a micrometre.
const NEAR_M: f64 = 16.0;

/// Where a cloud and its sensor are, in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Of the frame that the points are in; of an image's camera.
    pub base_from_frame: Isometry3<f64>,
    /// Of the sensor, where it is known.
    pub base_from_sensor: Option<Isometry3<f64>>,
}

/// A number of each point.
#[derive(Clone, Copy)]
struct Column {
    offset: usize,
    double: bool,
}

impl Column {
    fn read(self, point: &[u8]) -> f64 {
        let bytes = &point[self.offset..];
        if self.double {
            f64::from_le_bytes(std::array::from_fn(|i| bytes[i]))
        } else {
            f64::from(f32::from_le_bytes(std::array::from_fn(|i| bytes[i])))
        }
    }
}

/// The request that adds this cloud.
///
/// # Errors
/// What is wrong with the message, by the name of the field.
pub fn request(cloud: &PointCloud2, placement: &Placement) -> Result<ScanRequest, MessageError> {
    let rows = Rows::of(cloud)?;
    let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(|name| column(cloud, name)) else {
        let names: Vec<&str> = cloud.fields.iter().map(|f| f.name.as_str()).collect();
        return Err(MessageError::new(NAME, "fields", format!("{names:?}"), "x, y and z among them"));
    };
    let xyz = [x?, y?, z?];
    let mut made_of = MadeOf { kind: "cloud", ..MadeOf::default() };
    let normals = normals(cloud, &mut made_of.notes);
    let organised = cloud.height > 1;
    if organised {
        made_of.kind = "organised cloud";
    }

    let at = |point: &[u8], columns: [Column; 3]| columns.map(|c| c.read(point));
    let zeros = rows.points().filter(|point| at(point, xyz) == [0.0; 3]).count();
    let zeros_are_misses = zeros > 1 || organised;
    if zeros > 0 && zeros_are_misses {
        made_of.notes.push(format!("{zeros} points at exactly (0, 0, 0) are treated as pixels without a return"));
    }
    let mut points: Vec<[f64; 6]> = Vec::with_capacity(rows.count());
    let mut ahead = 0;
    let sensor_from_frame = placement.base_from_sensor.map(|sensor| sensor.inverse() * placement.base_from_frame);
    for point in rows.points() {
        let [px, py, pz] = at(point, xyz);
        let measured =
            px.is_finite() && py.is_finite() && pz.is_finite() && !(zeros_are_misses && [px, py, pz] == [0.0; 3]);
        if !measured {
            made_of.without += 1;
            if organised {
                points.push([f64::NAN; 6]);
            }
            continue;
        }
        made_of.returns += 1;
        let p = Point3::new(px, py, pz);
        ahead += usize::from(sensor_from_frame.is_none_or(|t| (t * p).z > 0.0));
        let p = placement.base_from_frame * p;
        let n = normals.map_or(Vector3::zeros(), |n| placement.base_from_frame.rotation * Vector3::from(at(point, n)));
        points.push([p.x, p.y, p.z, n.x, n.y, n.z]);
    }
    if made_of.returns == 0 {
        let found = format!("{} points, none with finite coordinates", made_of.without);
        return Err(MessageError::new(NAME, "data", found, "at least one point"));
    }
    if 2 * ahead < made_of.returns {
        made_of.notes.push(format!(
            "{} % of the points lie ahead of the sensor's frame: it is not an optical frame (+Z forward), so only its position is used",
            100 * ahead / made_of.returns
        ));
    }
    let size = if organised { [cloud.width as usize, cloud.height as usize] } else { [points.len(), 1] };
    let pcd = pcd(&points, size, normals.is_some(), placement.base_from_sensor.as_ref());
    let mut body = json!({ "cloud_base64": STANDARD.encode(pcd), "cloud_name": "cloud.pcd" });
    if let Some(sensor) = placement.base_from_sensor {
        body["from"] = json!(<[f64; 3]>::from(sensor.translation.vector));
    }
    Ok(ScanRequest { body: body.to_string().into_bytes(), made_of })
}

/// Where the points lie in the bytes.
struct Rows<'a> {
    data: &'a [u8],
    width: usize,
    height: usize,
    point_step: usize,
    row_step: usize,
}

impl<'a> Rows<'a> {
    fn of(cloud: &'a PointCloud2) -> Result<Self, MessageError> {
        let wrong = |place: &str, found: String, expected| Err(MessageError::new(NAME, place, found, expected));
        if cloud.is_bigendian {
            return wrong("is_bigendian", "true".to_owned(), "false: little-endian points");
        }
        let [width, height, point_step] = [cloud.width, cloud.height, cloud.point_step].map(|n| n as usize);
        let count = width.saturating_mul(height);
        if count == 0 {
            return wrong("width and height", format!("{width} x {height}"), "at least one point");
        }
        if point_step == 0 {
            return wrong("point_step", "0".to_owned(), "the bytes of a point");
        }
        let row = width.saturating_mul(point_step);
        // Of a single row it tells nothing, and some publishers leave it 0.
        let row_step = if height == 1 { row } else { cloud.row_step as usize };
        if row_step < row {
            let found = format!("{row_step} bytes for {width} points of {point_step}");
            return wrong("row_step", found, "width times point_step, or more");
        }
        let needed = row_step.saturating_mul(height - 1).saturating_add(row);
        if cloud.data.0.len() < needed {
            let found = format!("{} bytes for {width} x {height} points of {point_step}", cloud.data.0.len());
            return wrong("data", found, "row_step times height");
        }
        Ok(Self { data: &cloud.data.0, width, height, point_step, row_step })
    }

    fn count(&self) -> usize {
        self.width * self.height
    }

    fn points(&self) -> impl Iterator<Item = &'a [u8]> {
        let (data, step, row) = (self.data, self.point_step, self.width * self.point_step);
        let starts = (0..self.height).map(|r| r * self.row_step);
        starts.flat_map(move |start| data[start..start + row].chunks_exact(step))
    }
}

/// The field of this name; `None` where there is none.
fn column(cloud: &PointCloud2, name: &str) -> Option<Result<Column, MessageError>> {
    let mut named = cloud.fields.iter().filter(|f| f.name == name);
    let field = named.next()?;
    let wrong = |found: String, expected| Some(Err(MessageError::new(NAME, format!("field {name}"), found, expected)));
    if named.next().is_some() {
        return wrong("it twice".to_owned(), "every field once");
    }
    let double = match field.datatype {
        7 => false,
        8 => true,
        _ => return wrong(type_name(field), "float32 or float64"),
    };
    // Some publishers leave the count 0.
    if field.count > 1 {
        return wrong(format!("{} numbers", field.count), "one number");
    }
    let size = if double { 8 } else { 4 };
    if field.offset.checked_add(size).is_none_or(|end| end > cloud.point_step) {
        let found = format!("offset {} in points of {} bytes", field.offset, cloud.point_step);
        return wrong(found, "all its bytes in the point");
    }
    Some(Ok(Column { offset: field.offset as usize, double }))
}

fn type_name(field: &PointField) -> String {
    const NAMES: [&str; 8] = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"];
    let name = (field.datatype as usize).checked_sub(1).and_then(|i| NAMES.get(i));
    name.map_or_else(|| format!("type {}", field.datatype), |name| (*name).to_owned())
}

/// Normals, where all three are there as they should be.
fn normals(cloud: &PointCloud2, notes: &mut Vec<String>) -> Option<[Column; 3]> {
    let names = [["normal_x", "normal_y", "normal_z"], ["nx", "ny", "nz"]];
    let [Some(x), Some(y), Some(z)] =
        names.map(|n| n.map(|name| column(cloud, name))).into_iter().find(|n| n.iter().all(Option::is_some))?
    else {
        return None;
    };
    match (x, y, z) {
        (Ok(x), Ok(y), Ok(z)) => Some([x, y, z]),
        (x, y, z) => {
            let why = [x, y, z].into_iter().find_map(Result::err);
            notes.extend(why.map(|e| format!("its normals are not used: {e}")));
            None
        }
    }
}

/// Points as a binary PCD of this width and height, in the narrowest numbers that hold them.
fn pcd(points: &[[f64; 6]], [width, height]: [usize; 2], normals: bool, viewpoint: Option<&Isometry3<f64>>) -> Vec<u8> {
    let wide = points.iter().any(|p| p[..3].iter().any(|x| x.abs() >= NEAR_M));
    let (size, columns) = (if wide { 8 } else { 4 }, if normals { 6 } else { 3 });
    let names = ["x", "y", "z", "normal_x", "normal_y", "normal_z"][..columns].join(" ");
    let repeated = |word: &str| vec![word; columns].join(" ");
    let pose = viewpoint.copied().unwrap_or_default();
    let (t, q) = (pose.translation.vector, pose.rotation.quaternion());
    let header = format!(
        "VERSION 0.7\nFIELDS {names}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {width}\nHEIGHT {height}\n\
         VIEWPOINT {} {} {} {} {} {} {}\nPOINTS {}\nDATA binary\n",
        repeated(&size.to_string()),
        repeated("F"),
        repeated("1"),
        t.x,
        t.y,
        t.z,
        q.w,
        q.i,
        q.j,
        q.k,
        points.len()
    );
    let mut bytes = header.into_bytes();
    bytes.reserve(points.len() * columns * size);
    for value in points.iter().flat_map(|p| &p[..columns]) {
        match wide {
            true => bytes.extend_from_slice(&value.to_le_bytes()),
            false => bytes.extend_from_slice(&(*value as f32).to_le_bytes()),
        }
    }
    bytes
}

#[cfg(test)]
mod tests;
