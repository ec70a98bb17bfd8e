//! Depth images: 16-bit grey PNG (millimetres) and NPY (metres, or millimetres where the file holds integers).

use crate::FormatError;
use crate::error::Place;
use geometry::DepthImage;
use std::path::Path;

/// Reads a depth image; the ending of the name says the format. Zero, negative and non-finite depths are pixels
/// without a return. `metres_per_unit` is the value of one step of an integer image: 0.001 for millimetres.
///
/// # Errors
/// A file that cannot be read or is no such image.
pub fn read_depth(path: &Path, metres_per_unit: f64) -> Result<DepthImage, FormatError> {
    let bytes = std::fs::read(path).map_err(|e| FormatError::io(path, "read", e))?;
    parse_depth(path, &bytes, metres_per_unit)
}

/// [`read_depth`] on bytes at hand; `path` gives the format and stands in the errors.
///
/// # Errors
/// As [`read_depth`].
pub fn parse_depth(path: &Path, bytes: &[u8], metres_per_unit: f64) -> Result<DepthImage, FormatError> {
    match crate::extension(path).as_str() {
        "png" => parse_png(path, bytes, metres_per_unit),
        "npy" => {
            let array = crate::cloud::read_array(path, bytes, "an array of shape (rows, columns)")?;
            let [rows, columns] = array.shape[..] else {
                let place = Place::Part("shape".to_owned());
                return Err(FormatError::syntax(path, place, format!("{:?}", array.shape), "(rows, columns)"));
            };
            let unit = if array.integer { metres_per_unit } else { 1.0 };
            image(path, columns, rows, array.values.iter().map(|z| z * unit))
        }
        found => Err(FormatError::UnknownType {
            path: path.to_owned(),
            found: format!(".{found}"),
            expected: ".png (16-bit grey) or .npy",
        }),
    }
}

fn parse_png(path: &Path, bytes: &[u8], metres_per_unit: f64) -> Result<DepthImage, FormatError> {
    let refuse = |e: png::DecodingError| {
        FormatError::syntax(path, Place::Part("image".to_owned()), e.to_string(), "a PNG image of 16-bit grey")
    };
    let mut decoder = png::Decoder::new(bytes);
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
    let mut buffer = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut buffer).map_err(refuse)?;
    let values = buffer.chunks_exact(2).map(|b| f64::from(u16::from_be_bytes([b[0], b[1]])) * metres_per_unit);
    image(path, columns, rows, values)
}

fn image(
    path: &Path,
    columns: usize,
    rows: usize,
    values: impl Iterator<Item = f64>,
) -> Result<DepthImage, FormatError> {
    let size = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
    let (Some(width), Some(height)) = (size(columns), size(rows)) else {
        let found = format!("{columns} x {rows} pixels");
        return Err(FormatError::Empty { path: path.to_owned(), found, expected: "at least one pixel" });
    };
    let depth = values.map(|z| if z.is_finite() && z > 0.0 { z as f32 } else { 0.0 }).collect();
    Ok(DepthImage { origin: [0, 0], size: [width, height], depth })
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
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let window = DepthImage { origin: [1, 1], size: [2, 1], depth: vec![1.234, 0.0] };
        write_depth(&path, &window, 4, 3, 0.001).unwrap();
        let image = read_depth(&path, 0.001).unwrap();
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
        let text = |bytes: &[u8]| parse_depth(&path, bytes, 0.001).expect_err("must fail").to_string();
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
        assert!(parse_depth(Path::new("a.jpg"), b"", 1.0).expect_err("must fail").to_string().contains(".jpg"));
    }
}
