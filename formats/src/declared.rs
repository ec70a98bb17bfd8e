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
    const HEADER: usize = 4096;
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(HEADER)]);
    let is_data = |line: &&str| !line.trim_start().starts_with("DATA");
    let number = |key: &str| {
        let mut lines = head.lines().take_while(is_data);
        lines.find_map(|line| line.trim().strip_prefix(key)?.trim().parse::<u64>().ok())
    };
    head.lines().any(|line| line.trim_start().starts_with("VERSION")).then_some(())?;
    let area = number("WIDTH").zip(number("HEIGHT")).map(|(width, height)| width.saturating_mul(height));
    number("POINTS").max(area)
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
        let pcd =
            "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nWIDTH 4000000000\nHEIGHT 2\nPOINTS 7\nDATA ascii\nPOINTS 9e9\n";
        assert_eq!(count(pcd.as_bytes()), Some(8_000_000_000), "the larger of what it says");
        assert_eq!(count(b"1 2 3\n4 5 6\n"), None);
        assert_eq!(count(b""), None);
    }
}
