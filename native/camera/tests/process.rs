//! The camera as a process: its messages on the ring, its failures and its end.

#[path = "../../program/tests/support/process.rs"]
mod process;

use camera::scene::Scene;
use conduit_ring::{ContentTag, Publisher, PublisherOptions, Topic, clock};
use ganglion_messages::frame::{ENCODING, Frame, FrameHeader};
use process::{
    Process, await_end, call, next_message, printed_one_line, subscribe, unique_topic,
};
use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

const CAMERA: &str = env!("CARGO_BIN_EXE_camera");

fn start(topic: &Topic, more: &[&str]) -> Process {
    Process::start(CAMERA, &[&["--topic", topic.name()], more].concat())
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("process_{name}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn write_grey(path: &Path, width: u32, height: u32, grey: u8) {
    let mut encoder = png::Encoder::new(fs::File::create(path).expect("a file"), width, height);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().expect("a header");
    let pixels = vec![grey; (width * height) as usize];
    writer.write_image_data(&pixels).expect("pixels");
}

#[test]
fn frames_of_the_scene_arrive_in_order_and_show_the_time_of_their_number() {
    let topic = unique_topic("scene");
    let mut subscriber = subscribe(&topic);
    let started_ns = clock::now_ns();
    let _camera = start(
        &topic,
        &["--width", "320", "--height", "240", "--rate", "50"],
    );
    let scene = Scene::new(320, 240);
    let (mut expected, mut captured_ns) = (vec![0; 320 * 240], started_ns);
    for number in 0..5 {
        let (meta, message) = next_message(&mut subscriber);
        let frame = Frame::decode(&message).expect("a frame");
        let stamp_ns = frame.header.timestamp_ns;
        assert_eq!(frame.header, FrameHeader::grey(320, 240, stamp_ns, number));
        assert!(captured_ns < stamp_ns && stamp_ns <= meta.timestamp_ns);
        scene.render(u64::from(number), f64::from(number) / 50.0, &mut expected);
        assert!(
            frame.data == expected,
            "frame {number} shows something else"
        );
        captured_ns = stamp_ns;
    }
    assert_eq!(subscriber.content(), Some(ContentTag::of(ENCODING)));
}

#[test]
fn photographs_of_several_sizes_loop_in_the_order_of_their_names() {
    let folder = folder("sizes");
    write_grey(&folder.join("b.png"), 40, 20, 2);
    write_grey(&folder.join("a.png"), 3, 5, 1);
    write_grey(&folder.join("c.png"), 1, 1, 3);
    let topic = unique_topic("sizes");
    let mut subscriber = subscribe(&topic);
    let _camera = start(
        &topic,
        &["--frames", folder.to_str().unwrap(), "--rate", "50"],
    );
    for (number, expected) in [(3, 5, 1), (40, 20, 2), (1, 1, 3)]
        .iter()
        .cycle()
        .take(7)
        .enumerate()
    {
        let (_, message) = next_message(&mut subscriber);
        let frame = Frame::decode(&message).expect("a frame");
        let header = frame.header;
        assert_eq!(&(header.width, header.height, frame.data[0]), expected);
        assert_eq!(frame.data.len(), (header.width * header.height) as usize);
        assert_eq!(header.frame_id, number as u32);
    }
    assert_eq!(
        subscriber.geometry().unwrap().max_message_size() / 64,
        (44 + 800) / 64
    );
}

#[test]
fn sigterm_ends_it_with_its_topic_closed() {
    let topic = unique_topic("sigterm");
    let mut subscriber = subscribe(&topic);
    let camera = start(&topic, &["--rate", "0.01"]);
    next_message(&mut subscriber);
    camera.terminate();
    let ended = camera.end();
    assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    await_end(&mut subscriber);
    assert!(!topic.path().exists());
}

#[test]
fn the_end_of_stdin_ends_it_with_exit_with_stdin() {
    let topic = unique_topic("stdin");
    let mut subscriber = subscribe(&topic);
    let mut camera = start(&topic, &["--rate", "0.01", "--exit-with-stdin"]);
    next_message(&mut subscriber);
    camera.close_stdin();
    let ended = camera.end();
    assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    assert!(!topic.path().exists());
}

#[test]
fn the_end_of_stdin_is_ignored_without_exit_with_stdin() {
    let topic = unique_topic("no_stdin");
    let mut subscriber = subscribe(&topic);
    let mut camera = start(&topic, &["--rate", "50"]);
    camera.close_stdin();
    for _ in 0..10 {
        next_message(&mut subscriber);
    }
}

#[test]
fn a_camera_takes_over_the_topic_of_a_killed_one() {
    let topic = unique_topic("killed");
    let mut subscriber = subscribe(&topic);
    let first = start(&topic, &["--rate", "50"]);
    let (before, _) = next_message(&mut subscriber);
    first.kill();
    let _second = start(&topic, &["--rate", "50"]);
    let started_anew =
        |message: &[u8]| Frame::decode(message).expect("a frame").header.frame_id == 0;
    let mut next = next_message(&mut subscriber);
    while !started_anew(&next.1) {
        next = next_message(&mut subscriber);
    }
    assert!(next.0.sequence > before.sequence);
}

#[test]
fn help_exits_with_status_0() {
    let ended = call(CAMERA, &["--help"]);
    assert_eq!(
        (ended.status, ended.stdout.as_str()),
        (Some(0), camera::options::HELP)
    );
}

#[test]
fn a_usage_error_is_one_line_and_status_2() {
    for arguments in [
        &["--rate", "0", "--topic", "x"][..],
        &["--nonsense"],
        &[],
        &["--topic", "a/b"],
    ] {
        let ended = call(CAMERA, arguments);
        assert_eq!(ended.status, Some(2), "{arguments:?}");
        assert!(printed_one_line(&ended, "camera"), "{ended:?}");
    }
}

#[test]
fn a_photograph_that_cannot_be_read_is_one_line_and_status_1_and_nothing_is_published() {
    let folder = folder("broken");
    write_grey(&folder.join("a.png"), 3, 5, 1);
    fs::write(folder.join("broken.jpg"), "no picture").unwrap();
    let topic = unique_topic("broken");
    let mut subscriber = subscribe(&topic);
    let ended = start(&topic, &["--frames", folder.to_str().unwrap()]).end();
    assert_eq!(ended.status, Some(1));
    assert!(printed_one_line(&ended, "camera"), "{ended:?}");
    assert!(ended.stderr.contains("broken.jpg"), "{ended:?}");
    let read = subscriber.try_read(&mut Vec::new()).unwrap();
    assert_eq!(read, conduit_ring::Read::Nothing);
}

#[test]
fn a_check_needs_no_topic_and_reports_the_same_errors() {
    let folder = folder("checked");
    write_grey(&folder.join("a.png"), 3, 5, 1);
    let check = ["--check", "--frames", folder.to_str().unwrap()];
    let ended = call(CAMERA, &check);
    assert_eq!((ended.status, ended.stderr.as_str()), (Some(0), ""));
    fs::write(folder.join("broken.jpg"), "no picture").unwrap();
    let ended = call(CAMERA, &check);
    assert_eq!(ended.status, Some(1));
    assert!(printed_one_line(&ended, "camera"), "{ended:?}");
    assert!(ended.stderr.contains("broken.jpg"), "{ended:?}");
}

#[test]
fn a_folder_that_is_missing_or_empty_is_one_line_and_status_1() {
    let empty = folder("empty");
    for folder in [&empty, &empty.join("missing")] {
        let topic = unique_topic("no_folder");
        let ended = start(&topic, &["--frames", folder.to_str().unwrap()]).end();
        assert_eq!(ended.status, Some(1));
        assert!(printed_one_line(&ended, "camera"), "{ended:?}");
        assert!(ended.stderr.contains(folder.to_str().unwrap()), "{ended:?}");
    }
}

#[test]
fn a_topic_with_a_live_publisher_is_one_line_and_status_1() {
    let topic = unique_topic("taken");
    let _publisher = Publisher::open(&topic, &PublisherOptions::default()).unwrap();
    let ended = start(&topic, &[]).end();
    assert_eq!(ended.status, Some(1));
    assert!(printed_one_line(&ended, "camera"), "{ended:?}");
    assert!(ended.stderr.contains(topic.name()), "{ended:?}");
}

#[test]
fn a_removed_topic_is_created_again_between_two_frames_that_are_far_apart() {
    let topic = unique_topic("removed");
    let mut subscriber = subscribe(&topic);
    let _camera = start(&topic, &["--rate", "0.01"]);
    next_message(&mut subscriber);
    fs::remove_file(topic.path()).expect("a topic");
    let deadline = Instant::now() + Duration::from_secs(60);
    while !topic.path().exists() {
        assert!(Instant::now() < deadline, "it was not made anew");
        thread::sleep(Duration::from_millis(10));
    }
}
