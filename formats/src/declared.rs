//! What a file says it holds, before it is read: compressed ones may hold a thousand times their own size.

/// Points or pixels that a PNG image or a PCD cloud declares; `None` where it is neither, or does not say.
pub fn count(bytes: &[u8]) -> Option<u64> {
    png_pixels(bytes).or_else(|| pcd_points(bytes))
}

fn png_pixels(bytes: &[u8]) -> Option<u64> {
    let size = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(8..16)?;
    let number = |b: &[u8]| b.iter().fold(0u64, |n, &b| n << 8 | u64::from(b));
    Some(number(&size[..4]) * number(&size[4..]))
}

fn pcd_points(bytes: &[u8]) -> Option<u64> {
    /// Headers are short.
    const HEADER: usize = 1 << 16;
    crate::cloud::pcd_points(&bytes[..bytes.len().min(HEADER)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declared_counts_are_found_and_nothing_else_is() {
        let mut png = vec![];
        let mut encoder = png::Encoder::new(&mut png, 3, 5);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&[0; 30]).unwrap();
        assert_eq!(count(&png), Some(15));
        assert_eq!(count(&png[..20]), None, "cut off");
        let pcd = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 4000000000\nHEIGHT 2\nDATA ascii\nPOINTS 9\n";
        let with_points = pcd.replace("DATA", "POINTS 7\nDATA");
        assert_eq!(
            [pcd, &with_points].map(|pcd| count(pcd.as_bytes())),
            [Some(8_000_000_000), Some(7)],
            "as it is read"
        );
        assert_eq!(count(pcd.to_lowercase().replace('\n', "\r").as_bytes()), Some(8_000_000_000));
        assert_eq!(count(b"1 2 3\n4 5 6\n"), None);
        assert_eq!(count(b""), None);
    }
}
