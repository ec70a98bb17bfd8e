//! Bytes that rclpy's serialisation (of Fast DDS) and cyclonedds made of our messages.

use byteorder::LittleEndian;
use ros2::messages::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Debug;

const CLOUD: &str = "\
    0001000000f1536580b2e60e0700000063616d657261000101000000020000000300000002000000780000000000000007000000010000\
    000200000079006a24040000000700000001000000020000007a00000008000000070000000100000000007c190c000000180000001800\
    00000000803f0000004000004040000080400000a0400000c07f01\
";
const CAMERA_INFO: &str = "\
    0001000000f1536580b2e60e0700000063616d6572610000f0000000400100000a000000706c756d625f626f62009c01050000009a9999\
    999999b93f9a9999999999a9bffca9f1d24d62503ffca9f1d24d6250bf7b14ae47e17a843f0000000000c0724000000000000000000000\
    00000000644000000000000000000000000000d072400000000000005e4000000000000000000000000000000000000000000000f03f00\
    0000000000f03f000000000000000000000000000000000000000000000000000000000000f03f00000000000000000000000000000000\
    0000000000000000000000000000f03f0000000000b0724000000000000000000000000000e06340000000000000000000000000000000\
    000000000000a072400000000000c05d40000000000000000000000000000000000000000000000000000000000000f03f000000000000\
    000001000000000000000700000000000000000000000000000001\
";
const IMAGE: &str = "\
    0001000000f1536580b2e60e0700000063616d6572610074010000000200000006000000313655433100005f0400000004000000010002\
    00\
";
const MARKERS: &str = "\
    000100000100000000f1536580b2e60e0700000063616d65726100cc06000000636c6f7564000000030000000800000000000000000000\
    000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000f03f0000\
    00000000e03f000000000000000000000000000000000000803f00000000000000000000803f0000000000000000007e00000100000000\
    0000000000f03f0000000000000040000000000000084001000000000000000000803f0000000000000000010000000000000000000000\
    0000000001000000007e000001000000005500000000000000000000010000000000000001000000000000000100000000000000000000\
    0000\
";
const POSE: &str = "\
    0001000000f1536580b2e60e0700000063616d657261000000000000000000000000f83f00000000000000000000000000000000000000\
    000000000000000000000000000000000000000000000000000000f03f\
";
const TF: &str = "\
    0001000001000000050000000600000005000000626173650000000007000000666c616e6765000000000000000000000000f03f000000\
    00000000400000000000000840000000000000000000000000000000000000000000000000000000000000f03f\
";
const REQUEST: &str = "\
    0001000000550000\
";
const RESPONSE: &str = "\
    0001000001550000030000006f6b00\
";

/// What others wrote is what was meant, and what is written here reads as the same and is as long.
fn check<T: Serialize + DeserializeOwned + PartialEq + Debug>(theirs: &str, expected: &T) {
    let digits: Vec<char> = theirs.chars().collect();
    let bytes: Vec<u8> =
        digits.chunks(2).map(|d| u8::from_str_radix(&d.iter().collect::<String>(), 16).expect("hexadecimal")).collect();
    assert_eq!(bytes[..4], [0, 1, 0, 0], "CDR, little-endian");
    let read = |bytes: &[u8]| cdr_encoding::from_bytes::<T, LittleEndian>(bytes).expect("a message");
    let (message, length) = read(&bytes[4..]);
    assert_eq!(message, *expected);
    let ours = cdr_encoding::to_vec::<T, LittleEndian>(expected).expect("bytes");
    assert_eq!(ours.len(), length);
    assert_eq!(read(&ours).0, *expected);
}

fn header() -> Header {
    Header { stamp: Time { sec: 1_700_000_000, nanosec: 250_000_000 }, frame_id: "camera".to_owned() }
}

#[test]
fn a_cloud_is_laid_out_as_by_ros() {
    let fields = ["x", "y", "z"].iter().zip([0, 4, 8]);
    let fields = fields.map(|(name, offset)| PointField { name: (*name).to_owned(), offset, datatype: 7, count: 1 });
    let data = [1.0, 2.0, 3.0, 4.0, 5.0, f32::NAN].iter().flat_map(|x: &f32| x.to_le_bytes()).collect();
    let cloud = PointCloud2 {
        header: header(),
        height: 1,
        width: 2,
        fields: fields.collect(),
        is_bigendian: false,
        point_step: 12,
        row_step: 24,
        data: ByteArray(data),
        is_dense: true,
    };
    check(CLOUD, &cloud);
}

#[test]
fn a_camera_and_its_image_are_laid_out_as_by_ros() {
    let mut info = CameraInfo { header: header(), height: 240, width: 320, ..CameraInfo::default() };
    info.distortion_model = "plumb_bob".to_owned();
    info.d = vec![0.1, -0.05, 0.001, -0.001, 0.01];
    info.k = [300.0, 0.0, 160.0, 0.0, 301.0, 120.0, 0.0, 0.0, 1.0];
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    info.p = [299.0, 0.0, 159.0, 0.0, 0.0, 298.0, 119.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    info.binning_x = 1;
    info.roi = RegionOfInterest { x_offset: 7, do_rectify: true, ..RegionOfInterest::default() };
    check(CAMERA_INFO, &info);
    let data = ByteArray(vec![1, 0, 2, 0]);
    let image =
        Image { header: header(), height: 1, width: 2, encoding: "16UC1".to_owned(), is_bigendian: 0, step: 4, data };
    check(IMAGE, &image);
}

#[test]
fn answers_are_laid_out_as_by_ros() {
    let pose = Pose { position: Vector3 { x: 1.5, y: 0.0, z: 0.0 }, orientation: Quaternion::default() };
    check(POSE, &PoseStamped { header: header(), pose });
    let marker = Marker {
        header: header(),
        ns: "cloud".to_owned(),
        id: 3,
        r#type: Marker::POINTS,
        scale: Vector3 { x: 0.5, y: 0.0, z: 0.0 },
        color: Color { r: 1.0, a: 1.0, ..Color::default() },
        points: vec![Vector3 { x: 1.0, y: 2.0, z: 3.0 }],
        colors: vec![Color { g: 1.0, ..Color::default() }],
        ..Marker::default()
    };
    check(MARKERS, &MarkerArray { markers: vec![marker] });
}

#[test]
fn transforms_and_services_are_laid_out_as_by_ros() {
    let transform = TransformStamped {
        header: Header { stamp: Time { sec: 5, nanosec: 6 }, frame_id: "base".to_owned() },
        child_frame_id: "flange".to_owned(),
        transform: Transform { translation: Vector3 { x: 1.0, y: 2.0, z: 3.0 }, rotation: Quaternion::default() },
    };
    check(TF, &TFMessage { transforms: vec![transform] });
    check(RESPONSE, &TriggerResponse { success: true, message: "ok".to_owned() });
    let (_, length) = cdr_encoding::from_bytes::<TriggerRequest, LittleEndian>(&[0]).expect("a request");
    assert_eq!((length, REQUEST.len()), (1, 16));
}

#[test]
fn a_cut_message_is_an_error() {
    let whole = cdr_encoding::to_vec::<Text, LittleEndian>(&Text { data: "hello".to_owned() }).expect("bytes");
    for cut in 0..whole.len() {
        assert!(cdr_encoding::from_bytes::<Text, LittleEndian>(&whole[..cut]).is_err(), "{cut}");
    }
    // Four thousand million bytes, of which none comes.
    assert!(cdr_encoding::from_bytes::<ByteArray, LittleEndian>(&[0xff; 4]).is_err());
}

#[test]
fn times_are_whole_nanoseconds_before_the_epoch_too() {
    for ns in [0, 1, -1, 1_700_000_000_250_000_001, -1_500_000_000] {
        assert_eq!(Time::from_nanoseconds(ns).nanoseconds(), ns);
    }
    assert_eq!(Time::from_nanoseconds(-1), Time { sec: -1, nanosec: 999_999_999 });
}
