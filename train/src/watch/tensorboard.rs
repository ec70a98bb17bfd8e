//! TensorBoard event files. The format is two nested protobuf messages in length-prefixed records with
//! masked CRC-32C sums (TensorFlow: `lib/io/record_writer.cc`, `util/event.proto`, `framework/summary.proto`);
//! by hand, as the crates that write it bring a protobuf compiler or years-old dependencies.

use crate::TrainError;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Writes scalars.
#[derive(Debug)]
pub struct EventWriter {
    file: BufWriter<File>,
    path: PathBuf,
}

impl EventWriter {
    /// Creates a new event file in `dir`. A resumed run gets a further file; TensorBoard reads them as one,
    /// and the later file's values win where steps repeat.
    pub fn create(dir: &Path) -> Result<EventWriter, TrainError> {
        std::fs::create_dir_all(dir).map_err(|e| TrainError::io("create", dir, e))?;
        let now = wall_time();
        let path = dir.join(format!("events.out.tfevents.{:010}.{:09}.train", now as u64, (now.fract() * 1e9) as u32));
        let file = File::create_new(&path).map_err(|e| TrainError::io("create", &path, e))?;
        let mut writer = EventWriter { file: BufWriter::new(file), path };
        let mut event = Vec::new();
        double(&mut event, 1, now);
        bytes(&mut event, 3, b"brain.Event:2");
        writer.record(&event)?;
        Ok(writer)
    }

    /// Writes scalars of one step.
    pub fn scalars(&mut self, step: u64, values: &[(&str, f64)]) -> Result<(), TrainError> {
        let mut summary = Vec::new();
        for (tag, value) in values {
            let mut entry = Vec::new();
            bytes(&mut entry, 1, tag.as_bytes());
            key(&mut entry, 2, 5);
            entry.extend_from_slice(&(*value as f32).to_le_bytes());
            bytes(&mut summary, 1, &entry);
        }
        let mut event = Vec::new();
        double(&mut event, 1, wall_time());
        key(&mut event, 2, 0);
        varint(&mut event, step);
        bytes(&mut event, 5, &summary);
        self.record(&event)
    }

    /// Hands everything to the operating system.
    pub fn flush(&mut self) -> Result<(), TrainError> {
        self.file.flush().map_err(|e| TrainError::io("write", &self.path, e))
    }

    fn record(&mut self, data: &[u8]) -> Result<(), TrainError> {
        let length = (data.len() as u64).to_le_bytes();
        let mut framed = length.to_vec();
        framed.extend_from_slice(&masked_crc(&length).to_le_bytes());
        framed.extend_from_slice(data);
        framed.extend_from_slice(&masked_crc(data).to_le_bytes());
        self.file.write_all(&framed).map_err(|e| TrainError::io("write", &self.path, e))
    }
}

fn wall_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn key(out: &mut Vec<u8>, field: u8, wire_type: u8) {
    out.push(field << 3 | wire_type);
}

fn double(out: &mut Vec<u8>, field: u8, value: f64) {
    key(out, field, 1);
    out.extend_from_slice(&value.to_le_bytes());
}

fn bytes(out: &mut Vec<u8>, field: u8, data: &[u8]) {
    key(out, field, 2);
    varint(out, data.len() as u64);
    out.extend_from_slice(data);
}

/// CRC-32C (Castagnoli, reflected polynomial 0x82f63b78), a bit at a time: event files are small.
fn crc32c(data: &[u8]) -> u32 {
    !data.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0x82f6_3b78 } else { c >> 1 })
    })
}

fn masked_crc(data: &[u8]) -> u32 {
    crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test vectors of RFC 3720, appendix B.4.
    #[test]
    fn crc32c_agrees_with_its_rfc() {
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        let rising: Vec<u8> = (0..32).collect();
        assert_eq!(crc32c(&rising), 0x46dd_794e);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn an_event_file_reads_back() {
        let dir = tempfile::tempdir().expect("temp dir");
        let mut writer = EventWriter::create(dir.path()).expect("create");
        writer.scalars(300, &[("loss/train", 0.25), ("rate", 1e-3)]).expect("write");
        writer.flush().expect("flush");
        let data = std::fs::read(&writer.path).expect("read");
        let mut rest = &data[..];
        let mut events = Vec::new();
        while !rest.is_empty() {
            let length = u64::from_le_bytes(rest[..8].try_into().expect("8 bytes")) as usize;
            assert_eq!(masked_crc(&rest[..8]), u32::from_le_bytes(rest[8..12].try_into().expect("4 bytes")));
            let body = &rest[12..12 + length];
            let sum = u32::from_le_bytes(rest[12 + length..16 + length].try_into().expect("4 bytes"));
            assert_eq!(masked_crc(body), sum);
            events.push(body.to_vec());
            rest = &rest[16 + length..];
        }
        assert_eq!(events.len(), 2, "a header and one event");
        assert!(events[0].ends_with(b"\x1a\x0dbrain.Event:2"));
        // step 300 = 0xac 0x02 as a varint, field 2; the tag and the little-endian float of the summary.
        assert_eq!(events[1][9..12], [0x10, 0xac, 0x02]);
        let mut scalar = b"\x0a\x0aloss/train\x15".to_vec();
        scalar.extend_from_slice(&0.25f32.to_le_bytes());
        assert!(events[1].windows(scalar.len()).any(|w| w == scalar), "{:?}", events[1]);
    }
}
