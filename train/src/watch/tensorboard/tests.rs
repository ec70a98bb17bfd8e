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
