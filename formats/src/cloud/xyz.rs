//! Text clouds: one point per line, numbers apart by blanks, commas or semicolons. No crate reads them.

use super::CloudFile;
use crate::FormatError;
use crate::error::Place;
use std::path::Path;

/// Three columns are positions; columns four to six are normals where all of them have unit length (within
/// 5 %), else colours or intensities, which are ignored as all further ones are. `#` and `//` begin comments; one
/// line of words may stand above the numbers, and one with a lone count.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let mut rows: Vec<([f64; 3], [f64; 3])> = vec![];
    let mut six = true;
    let mut header_seen = false;
    for (index, line) in text.lines().enumerate() {
        let content = line.split(['#']).next().unwrap_or("").split("//").next().unwrap_or("");
        let mut numbers = [0.0; 6];
        let mut count = 0;
        let mut wrong = None;
        for word in content.split([' ', '\t', ',', ';', '\r', '\u{feff}']).filter(|w| !w.is_empty()) {
            match word.parse::<f64>() {
                Ok(number) if count < 6 => numbers[count] = number,
                Ok(_) => {}
                Err(_) if count < 3 => {
                    wrong = Some(word);
                    break;
                }
                Err(_) => break, // a label behind the position
            }
            count += 1;
        }
        if count == 0 && wrong.is_none() {
            continue;
        }
        if count < 3 {
            if rows.is_empty() && !header_seen && (wrong.is_some() || count == 1) {
                header_seen = true;
                continue;
            }
            let found = wrong.map_or_else(|| format!("{count} numbers"), |w| format!("{w:?}"));
            return Err(FormatError::syntax(path, Place::Line(index + 1), found, "three coordinates"));
        }
        let [x, y, z, a, b, c] = numbers;
        let unit = ((a * a + b * b + c * c).sqrt() - 1.0).abs() < 0.05;
        six &= count >= 6 && (unit || !(x + y + z).is_finite());
        rows.push(([x, y, z], [a, b, c]));
    }
    CloudFile::gather(path, rows.into_iter().map(|(p, n)| (p, six.then_some(n))), None)
}

#[cfg(test)]
mod tests {
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
        assert_eq!(
            read("5600000.25 1 1").unwrap().cloud.points[0].x,
            5_600_000.25,
            "survey coordinates keep their digits"
        );
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
}
