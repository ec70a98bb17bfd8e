//! Depth images: 16-bit grey PNG (millimetres) and NPY (metres, or millimetres where the file holds integers).

use crate::FormatError;
use crate::error::Place;
use geometry::DepthImage;
use std::path::Path;

/// Metres per step of an integer image, where nothing else is said.
pub const MILLIMETRES: f64 = 0.001;

/// A depth image as its file holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFile {
    /// In metres; 0 where there is no return.
    pub image: DepthImage,
    /// What a user should know of how the file was read: what was guessed, what was left out.
    pub notes: Vec<String>,
}

/// Reads a depth image; the ending of the name says the format. Zero, negative and non-finite depths are pixels
/// without a return, and so is the largest value that the integers of the file can take. `metres_per_unit` is the value of
/// one step; where it is not given, integers are millimetres and floats metres.
///
/// # Errors
/// A file that cannot be read or is no such image.
pub fn read_depth(path: &Path, metres_per_unit: Option<f64>) -> Result<DepthFile, FormatError> {
    parse_depth(path, &crate::file::read(path)?, metres_per_unit)
}

/// [`read_depth`] on bytes at hand; `path` gives the format and stands in the errors.
///
/// # Errors
/// As [`read_depth`].
pub fn parse_depth(path: &Path, bytes: &[u8], metres_per_unit: Option<f64>) -> Result<DepthFile, FormatError> {
    match crate::extension(path).as_str() {
        "png" => parse_png(path, bytes, metres_per_unit),
        "npy" => {
            let array = crate::cloud::read_array(path, bytes, "an array of shape (rows, columns)")?;
            let [rows, columns] = array.shape[..] else {
                let place = Place::Part("shape".to_owned());
                return Err(FormatError::syntax(path, place, format!("{:?}", array.shape), "(rows, columns)"));
            };
            let mut file = image(path, [columns, rows], array.values, array.largest_integer, metres_per_unit)?;
            if array.left > 0 {
                file.notes.push(format!("{} bytes follow after the array and were not read", array.left));
            }
            Ok(file)
        }
        found => Err(FormatError::UnknownType {
            path: path.to_owned(),
            found: format!(".{found}"),
            expected: ".png (16-bit grey) or .npy",
        }),
    }
}

/// Metres per unit of BOP's depth images, which `depth_scale` makes millimetres of.
pub(crate) fn bop_unit(path: &Path, place: Place, depth_scale: f64) -> Result<f64, FormatError> {
    match depth_scale > 0.0 && depth_scale.is_finite() {
        true => Ok(MILLIMETRES * depth_scale),
        false => {
            let found = format!("a depth_scale of {depth_scale}");
            Err(FormatError::syntax(path, place, found, "a positive number: millimetres per unit of depth"))
        }
    }
}

/// What there is to say where the file of a camera tells the unit of `image`: which one counts, unless it is the usual one.
/// `given` is the one that a user gave, known to him as `name`.
pub fn told_unit(image: &Path, given: Option<f64>, told: Option<f64>, name: &str) -> Option<String> {
    let told = told?;
    let same = |unit: f64| (unit / told - 1.0).abs() < 1e-9;
    match given {
        Some(given) if same(given) => None,
        Some(given) => Some(format!(
            "the camera's file has depth in units of {told} m (depth_scale), but it was read in units of {given} m as {name} says"
        )),
        None if same(MILLIMETRES) && crate::extension(image) == "png" => None,
        None => {
            Some(format!("read in units of {told} m, as the camera's file says (depth_scale); {name} would replace it"))
        }
    }
}

fn parse_png(path: &Path, bytes: &[u8], metres_per_unit: Option<f64>) -> Result<DepthFile, FormatError> {
    let refuse = |e: png::DecodingError| {
        FormatError::syntax(path, Place::Part("image".to_owned()), e.to_string(), "a PNG image of 16-bit grey")
    };
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(refuse)?;
    let info = reader.info();
    let (columns, rows) = (info.width as usize, info.height as usize);
    if (info.color_type, info.bit_depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        let found = format!("{:?} of {:?} bits", info.color_type, info.bit_depth);
        return Err(FormatError::syntax(path, Place::Part("header".to_owned()), found, "grey of sixteen bits"));
    }
    // Deflate cannot make more than 1032 bytes of one.
    let (found, most) = (columns as u64 * rows as u64, bytes.len() as u64 * 1032 / 2);
    if found > most {
        let place = Place::Part("header".to_owned());
        return Err(FormatError::Count { path: path.to_owned(), place, what: "pixels".to_owned(), found, most });
    }
    // Two bytes as they are, four as a depth.
    crate::file::check_unpacked(path, format!("an image of {columns} x {rows} pixels"), 6 * found, bytes.len())?;
    let clear: Option<[u8; 2]> = info.trns.as_deref().and_then(|value| value.try_into().ok());
    let mut buffer = vec![0; 2 * columns * rows];
    reader.next_frame(&mut buffer).map_err(refuse)?;
    let mut left_out = 0;
    if let Some(clear) = clear {
        for pixel in buffer.chunks_exact_mut(2).filter(|pixel| *pixel == clear) {
            pixel.fill(0);
            left_out += 1;
        }
    }
    let values = buffer.chunks_exact(2).map(|b| f64::from(u16::from_be_bytes([b[0], b[1]])));
    let mut file = image(path, [columns, rows], values, Some(f64::from(u16::MAX)), metres_per_unit)?;
    if left_out > 0 {
        file.notes.push(format!("{left_out} transparent pixels are taken for pixels without a return"));
    }
    Ok(file)
}

/// A depth image from its values, row by row, as [`read_depth`] would make it of a file that holds them. `largest_integer` is
/// the largest value that their type can take, where that is one of integers; `path` stands in the errors.
///
/// # Errors
/// An image without pixels.
pub fn image(
    path: &Path,
    [columns, rows]: [usize; 2],
    values: impl IntoIterator<Item = f64>,
    largest_integer: Option<f64>,
    metres_per_unit: Option<f64>,
) -> Result<DepthFile, FormatError> {
    let size = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
    let (Some(width), Some(height)) = (size(columns), size(rows)) else {
        let found = format!("{columns} x {rows} pixels");
        return Err(FormatError::Empty { path: path.to_owned(), found, expected: "at least one pixel" });
    };
    let unit = metres_per_unit.unwrap_or(if largest_integer.is_some() { MILLIMETRES } else { 1.0 });
    let mut marked = 0;
    let metres = |value: f64| {
        let mark = Some(value) == largest_integer;
        marked += usize::from(mark);
        let z = value * unit;
        if z.is_finite() && z > 0.0 && !mark { z as f32 } else { 0.0 }
    };
    let depth: Vec<f32> = values.into_iter().map(metres).collect();
    let mut notes = vec![];
    if marked > 0 {
        let largest = largest_integer.unwrap_or_default();
        notes
            .push(format!("{marked} pixels with the largest value, {largest}, are treated as pixels without a return"));
    }
    match largest_integer {
        Some(most) if most <= 255.0 && metres_per_unit.is_none() => notes.push(format!(
            "integers of one byte are taken for millimetres, {most} at most: a picture of the depths? Give the depths as measured, or \
             the unit (--depth-unit, metres_per_unit, depth_unit_m of a sequence)"
        )),
        _ => notes.extend(odd_unit(&depth, largest_integer.is_some(), metres_per_unit)),
    }
    notes.extend(far_mark(&depth));
    Ok(DepthFile { image: DepthImage { origin: [0, 0], size: [width, height], depth }, notes })
}

/// What is odd about the depths in the unit that was given, or guessed.
fn odd_unit(depth: &[f32], integer: bool, given: Option<f64>) -> Option<String> {
    let mut known: Vec<f32> = depth.iter().copied().filter(|&z| z > 0.0).collect();
    let middle = known.len() / 2;
    let (_, &mut median, _) = (!known.is_empty()).then(|| known.select_nth_unstable_by(middle, f32::total_cmp))?;
    match (given, integer) {
        (Some(unit), _) if median < 0.001 => Some(format!(
            "half of the depths are below 1 mm in the given unit of {unit} m: are they in metres already?"
        )),
        (None, false) if median > 50.0 => Some(format!(
            "floats are read as metres, but half of the depths are above {median:.0} m: if they are millimetres, say so \
             (--depth-unit 0.001, metres_per_unit, depth_unit_m of a sequence)"
        )),
        (None, true) if median < 0.02 => Some(format!(
            "integers are read as millimetres, but half of the depths are below {:.0} mm: if the unit is different, say so \
             (--depth-unit, metres_per_unit, depth_unit_m of a sequence)",
            median * 1000.0 + 1.0
        )),
        _ => None,
    }
}

/// A single value behind all others that many pixels have.
fn far_mark(depth: &[f32]) -> Option<String> {
    let most = |under: f32| depth.iter().copied().filter(|&z| z < under).fold(0.0, f32::max);
    let far = most(f32::INFINITY);
    let next = most(far);
    let count = depth.iter().filter(|&&z| z == far).count();
    (next > 0.0 && next < 0.5 * far && count * 20 > depth.len()).then(|| {
        format!(
            "{count} pixels are all {far} m away, the others at most {next} m: if that means no return, write 0 instead"
        )
    })
}

/// Writes a depth image as 16-bit grey PNG of `width` x `height` pixels, in steps of `metres_per_unit`.
///
/// # Errors
/// What the operating system refuses; an image without pixels.
pub fn write_depth(
    path: &Path,
    image: &DepthImage,
    width: u32,
    height: u32,
    metres_per_unit: f64,
) -> Result<(), FormatError> {
    let mut values = Vec::with_capacity(width as usize * height as usize * 2);
    for row in 0..height {
        for column in 0..width {
            let z = image.at(column, row).unwrap_or(0.0);
            values.extend(((f64::from(z) / metres_per_unit).round() as u16).to_be_bytes());
        }
    }
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(&values))
        .map_err(|e| FormatError::syntax(path, Place::File, e.to_string(), "an image with pixels"))?;
    crate::run::atomic_write(path, &bytes)
}

#[cfg(test)]
mod tests;
