use super::*;
use crate::messages::{Time, TransformStamped};

fn config() -> Ros2Config {
    let [base_frame, cloud_topic] = ["base", "/points"].map(str::to_owned);
    Ros2Config { base_frame, cloud_topic, wait_s: 0.0, ..Ros2Config::default() }
}

fn scan(frame: &str, sec: i32) -> Measurement {
    let header = Header { stamp: Time { sec, nanosec: 0 }, frame_id: frame.to_owned() };
    Measurement::Cloud(Arc::new(PointCloud2 { header, ..PointCloud2::default() }))
}

fn tell(inbox: &Inbox, child: &str, x: f64, sec: i32, fixed: bool) {
    let mut transform = TransformStamped { child_frame_id: child.to_owned(), ..TransformStamped::default() };
    (transform.header.frame_id, transform.header.stamp.sec) = ("base".to_owned(), sec);
    transform.transform.translation.x = x;
    inbox.take_transforms(&TFMessage { transforms: vec![transform] }, fixed);
}

fn ready(inbox: &Inbox, config: &Ros2Config) -> Result<Ready, Refused> {
    inbox.ready(config, &AtomicBool::new(false))
}

#[test]
fn a_scan_waits_for_its_transform() {
    let inbox = Inbox::new(Duration::from_secs(60));
    tell(&inbox, "camera", 1.0, 5, false);
    inbox.take_scan("a".to_owned(), scan("camera", 6));
    let early = ready(&inbox, &config()).expect_err("its transform is not here");
    assert_eq!(early.code, "no_transform");
    assert!(early.message.contains("is 1.000 s older than the message"), "{}", early.message);
    let patient = Ros2Config { wait_s: 60.0, ..config() };
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| ready(&inbox, &patient));
        tell(&inbox, "camera", 3.0, 7, false);
        let found = waiting.join().expect("no panic").expect("a scan");
        assert_eq!(found.placement.base_from_frame.translation.x, 2.0);
        assert!(found.notes[0].contains("interpolated between transforms 2.0 s apart"), "{:?}", found.notes);
    });
}

#[test]
fn points_in_the_base_frame_need_the_name_of_their_camera() {
    let inbox = Inbox::new(Duration::from_secs(60));
    tell(&inbox, "camera", 1.0, 0, true);
    inbox.take_scan("a".to_owned(), scan("base", 6));
    let unknown = ready(&inbox, &config()).expect("a scan");
    assert_eq!(unknown.placement.base_from_sensor, None);
    assert!(unknown.notes[0].contains("ros2.sensor_frame"), "{:?}", unknown.notes);
    let named = ready(&inbox, &Ros2Config { sensor_frame: "camera".to_owned(), ..config() }).expect("a scan");
    assert_eq!(named.placement.base_from_sensor.map(|p| p.translation.x), Some(1.0));
    assert_eq!(named.notes, Vec::<String>::new());
}

/// An image with its camera, in this frame.
fn see(inbox: &Inbox, frame: &str) {
    let header = Header { stamp: Time { sec: 6, nanosec: 0 }, frame_id: frame.to_owned() };
    inbox.take_camera(CameraInfo { header: header.clone(), ..CameraInfo::default() });
    inbox.take_scan("a".to_owned(), Measurement::Depth(Arc::new(Image { header, ..Image::default() })));
}

fn of_images() -> Ros2Config {
    Ros2Config { depth_topic: "/eye/depth".to_owned(), cloud_topic: String::new(), ..config() }
}

#[test]
fn an_image_in_the_base_frame_was_taken_from_its_origin() {
    let inbox = Inbox::new(Duration::from_secs(60));
    see(&inbox, "base");
    let found = ready(&inbox, &of_images()).expect("a scan");
    assert_eq!(found.placement.base_from_sensor, Some(found.placement.base_from_frame));
    assert!(matches!(&found.notes[..], [note] if note.contains("in the origin of that frame")), "{:?}", found.notes);
}

#[test]
fn the_frame_of_an_image_need_not_be_known_where_that_of_its_camera_is_named() {
    let inbox = Inbox::new(Duration::from_secs(60));
    tell(&inbox, "camera", 1.0, 5, false);
    tell(&inbox, "camera", 3.0, 7, false);
    see(&inbox, "in_no_tree");
    assert_eq!(ready(&inbox, &of_images()).expect_err("unknown").code, "no_transform");
    let named = Ros2Config { sensor_frame: "camera".to_owned(), ..of_images() };
    let found = ready(&inbox, &named).expect("a scan");
    assert_eq!(found.placement.base_from_frame.translation.x, 2.0);
    assert_eq!(found.notes.len(), 1, "told once: {:?}", found.notes);
}

#[test]
fn several_publishers_are_told() {
    let inbox = Inbox::new(Duration::from_secs(60));
    tell(&inbox, "left", 1.0, 0, true);
    tell(&inbox, "right", 2.0, 0, true);
    inbox.take_scan("a".to_owned(), scan("left", 6));
    inbox.take_scan("b".to_owned(), scan("right", 6));
    let found = ready(&inbox, &config()).expect("a scan");
    assert_eq!(found.used.frame, "right");
    assert!(
        found.notes[0].contains("2 publishers send on /points (in frames [\"left\", \"right\"])"),
        "{:?}",
        found.notes
    );
    inbox.mark_used(found.number);
    assert_eq!(ready(&inbox, &config()).expect_err("used").code, "no_new_scan");
    inbox.take_scan("a".to_owned(), scan("left", 7));
    assert_eq!(ready(&inbox, &config()).expect("another").used.frame, "left");
}

#[test]
fn what_a_scan_lacks_is_said() {
    let inbox = Inbox::new(Duration::from_secs(60));
    tell(&inbox, "camera", 1.0, 0, true);
    inbox.could_not_read("it ends too early".to_owned());
    let none = ready(&inbox, &config()).expect_err("nothing");
    assert_eq!(
        none.message,
        "nothing has arrived on /points; the last message there could not be read: it ends too early"
    );
    inbox.take_scan("a".to_owned(), scan("", 6));
    assert_eq!(ready(&inbox, &config()).expect_err("no frame").code, "no_frame");
    inbox.take_scan("a".to_owned(), scan("camera", 0));
    let timeless = ready(&inbox, &config()).expect("a scan");
    assert_eq!(timeless.notes, ["the scan has no time: the newest transforms were used"]);
    let mut image = Image::default();
    image.header.frame_id = "camera".to_owned();
    inbox.take_scan("a".to_owned(), Measurement::Depth(Arc::new(image)));
    let blind = ready(&inbox, &of_images()).expect_err("no camera");
    assert_eq!(blind.message, "no CameraInfo of \"camera\" has arrived on /eye/camera_info (of others: [])");
}
