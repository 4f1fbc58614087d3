//! The detector as a process between real rings: its messages, its failures and its end.

#[path = "../../program/tests/support/process.rs"]
mod process;
#[path = "../../program/tests/support/shared_data.rs"]
mod shared_data;

use camera::options::{Options, Picture};
use camera::scene::{Scene, TAG_IDS};
use conduit_ring::{
    ContentTag, Geometry, Info, Publisher, PublisherOptions, Read, Subscriber, Topic, clock,
};
use ganglion_messages::frame::{self, FrameHeader};
use ganglion_messages::imu::{self, Imu};
use ganglion_messages::stamp::Stamp;
use ganglion_messages::tags::{self, FrameSource, TagDetections};
use process::{
    PATIENCE, Process, TestTopic, await_end, call, next_message, printed_one_line, subscribe,
    unique_topic,
};
use program::Log;
use program::stop::Stop;
use shared_data::tags_folder;
use std::thread;
use std::time::{Duration, Instant};

const VISION_TAGS: &str = env!("CARGO_BIN_EXE_vision_tags");
const RATE: f64 = 20.0;

/// The three topics of a test and the detector between them.
struct Setup {
    detections: Subscriber,
    detector: Process,
    frames: TestTopic,
    imu: TestTopic,
    /// The topic of `detections`.
    _published: TestTopic,
}

fn setup(name: &str, more: &[&str]) -> Setup {
    let [frames, imu, detections] =
        ["frames", "imu", "tags"].map(|part| unique_topic(&format!("{name}.{part}")));
    Setup {
        detector: start(&frames, &imu, &detections, more),
        detections: subscribe(&detections),
        frames,
        imu,
        _published: detections,
    }
}

fn start(frames: &Topic, imu: &Topic, detections: &Topic, more: &[&str]) -> Process {
    let [frames, imu, detections] = [frames, imu, detections].map(Topic::name);
    let topics = ["--frames", frames, "--imu", imu, "--detections", detections];
    Process::start(VISION_TAGS, &[&topics, more].concat())
}

impl Setup {
    fn next_detections(&mut self) -> TagDetections {
        let (_, message) = next_message(&mut self.detections);
        TagDetections::decode(&message).expect("detections")
    }
}

/// A camera in a thread. It stops on drop.
struct Camera(Stop, Option<thread::JoinHandle<()>>);

impl Camera {
    fn start(topic: &Topic) -> Camera {
        let (width, height) = (320, 240);
        Camera::showing(Picture::Scene { width, height }, topic)
    }

    fn showing(picture: Picture, topic: &Topic) -> Camera {
        let stop = Stop::new();
        let options = Options {
            topic: topic.clone(),
            rate_hz: RATE,
            picture,
            slots: 4,
            exit_with_stdin: false,
        };
        let stopped = stop.clone();
        let thread = thread::spawn(move || {
            camera::run(&options, &stopped, Log::of("camera")).expect("a camera");
        });
        Camera(stop, Some(thread))
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        self.0.request();
        let ended = self.1.take().map(thread::JoinHandle::join);
        assert!(thread::panicking() || matches!(ended, Some(Ok(()))));
    }
}

fn open(topic: &Topic, encoding: Option<&str>, largest: u32) -> Publisher {
    let options = PublisherOptions {
        geometry: Geometry::depth(16, largest).expect("a geometry"),
        content: encoding.map_or(ContentTag::RAW, ContentTag::of),
        ..PublisherOptions::default()
    };
    Publisher::open(topic, &options).expect("a publisher")
}

/// Returns a frame without tags, captured now.
fn blank(frame_id: u32) -> Vec<u8> {
    let header = FrameHeader::grey(64, 48, clock::now_ns(), frame_id);
    let mut message = header.encode().to_vec();
    message.resize(FrameHeader::SIZE + 64 * 48, 100);
    message
}

/// Publishes a frame repeatedly until detections arrive, because the detector may not have
/// started yet. Waits before each repetition, so that the detector can handle the frame before.
fn publish_until_seen(
    frames: &mut Publisher,
    message: &[u8],
    setup: &mut Setup,
) -> TagDetections {
    let pause = Duration::from_millis(20);
    let mut published = Vec::new();
    loop {
        let read = setup.detections.read_timeout(&mut published, pause);
        if matches!(read, Ok(Read::Message(_))) {
            return TagDetections::decode(&published).expect("detections");
        }
        frames.publish(message).expect("it fits");
    }
}

#[test]
fn the_tags_of_a_cameras_frames_are_published_with_their_true_places() {
    let mut setup = setup("truth", &[]);
    let _camera = Camera::start(&setup.frames);
    let scene = Scene::new(320, 240);
    let mut last = None;
    for _ in 0..5 {
        let published = setup.next_detections();
        let source = published.source.expect("a frame");
        assert_eq!((source.image_width, source.image_height), (320, 240));
        assert_eq!(source.frame_sequence, u64::from(source.frame_id));
        assert!(last < Some(source.frame_id));
        assert_eq!(source.angular_speed, None);
        assert_eq!(published.frame_id, setup.frames.name());
        let wall_ns = published.stamp.unix_ns() - clock::realtime_offset_ns();
        assert!(wall_ns.abs_diff(source.capture_time_ns as i64) < 1_000_000_000);
        let seconds = f64::from(source.frame_id) / RATE;
        assert_eq!(published.detections.len(), TAG_IDS.len());
        for (tag, truth) in published.detections.iter().zip(scene.tags_at(seconds)) {
            assert_eq!((tag.id, tag.family.as_str()), (truth.id as i32, "tag36h11"));
            for (corner, true_corner) in tag.corners.iter().zip(truth.corners) {
                assert!((corner[0] - true_corner[0]).hypot(corner[1] - true_corner[1]) < 1.0);
            }
        }
        last = Some(source.frame_id);
    }
    assert_eq!(
        setup.detections.content(),
        Some(ContentTag::of(tags::ENCODING))
    );
}

#[test]
fn the_tags_of_photographs_are_published_photograph_by_photograph() {
    let Some(folder) = tags_folder() else { return };
    let mut setup = setup("photographs", &[]);
    let _camera = Camera::showing(Picture::Photographs(folder), &setup.frames);
    let mut seen = [false; 2];
    while seen.contains(&false) {
        let published = setup.next_detections();
        let photograph = published.source.expect("a frame").frame_id as usize % 2;
        assert_eq!(published.detections.len(), [12, 10][photograph]);
        seen[photograph] = true;
    }
}

#[test]
fn a_camera_may_stop_and_start_again() {
    let mut setup = setup("back", &[]);
    for _ in 0..2 {
        let _camera = Camera::start(&setup.frames);
        let mut source = setup.next_detections().source.expect("a frame");
        while source.frame_id < 2 {
            source = setup.next_detections().source.expect("a frame");
        }
    }
}

#[test]
fn a_frame_without_tags_is_reported_too() {
    let mut setup = setup("blank", &[]);
    let mut frames = open(&setup.frames, Some(frame::ENCODING), 10_000);
    let before_ns = clock::now_ns();
    let published = publish_until_seen(&mut frames, &blank(7), &mut setup);
    assert_eq!(published.detections, []);
    let source = published.source.expect("a frame");
    assert_eq!(source.frame_id, 7);
    assert!(source.capture_time_ns > before_ns);
}

#[test]
fn messages_that_are_not_frames_are_rejected_and_the_next_frame_is_used() {
    let mut setup = setup("refused", &[]);
    let mut frames = open(&setup.frames, None, 10_000);
    publish_until_seen(&mut frames, &blank(0), &mut setup);
    let mut colour = blank(1);
    colour[12..16].copy_from_slice(b"YUYV");
    let cut = blank(1)[..200].to_vec();
    for message in [vec![], vec![0; 43], vec![0xFF; 5000], cut, colour] {
        frames.publish(&message).unwrap();
        let published = publish_until_seen(&mut frames, &blank(9), &mut setup);
        assert_eq!(published.source.expect("a frame").frame_id, 9);
    }
    let stderr = end(setup.detector);
    let refusals = stderr.lines().filter(|line| line.contains("rejected: "));
    assert_eq!(refusals.count(), 1, "{stderr}");
}

/// Terminates the detector and returns its stderr.
fn end(detector: Process) -> String {
    detector.terminate();
    let ended = detector.end();
    assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    ended.stderr
}

#[test]
fn a_topic_of_another_encoding_is_rejected_with_all_its_messages() {
    let mut setup = setup("foreign", &[]);
    {
        let mut frames = open(&setup.frames, Some(imu::ENCODING), 10_000);
        frames.publish(&blank(1)).unwrap();
    }
    let mut frames = open(&setup.frames, Some(frame::ENCODING), 10_000);
    let published = publish_until_seen(&mut frames, &blank(2), &mut setup);
    assert_eq!(published.source.expect("a frame").frame_id, 2);
}

/// Publishes samples of a turn and blank frames in turn until the detections include a speed.
fn detections_with_speed(setup: &mut Setup, sample: impl Fn() -> Imu) -> FrameSource {
    let mut frames = open(&setup.frames, Some(frame::ENCODING), 10_000);
    let mut samples = open(&setup.imu, Some(imu::ENCODING), 1000);
    loop {
        samples.publish(&sample().encode()).expect("it fits");
        let published = publish_until_seen(&mut frames, &blank(0), setup);
        let source = published.source.expect("a frame");
        if source.angular_speed.is_some() {
            return source;
        }
    }
}

fn turn(stamp: Stamp) -> Imu {
    Imu {
        stamp,
        angular_velocity: [2.0, -3.0, 6.0],
        ..Imu::default()
    }
}

#[test]
fn the_angular_speed_at_the_capture_time_is_published_once_the_imu_has_started() {
    let mut setup = setup("speed", &[]);
    let now = || Stamp::from_unix_ns(clock::now_ns() as i64 + clock::realtime_offset_ns());
    let source = detections_with_speed(&mut setup, || turn(now()));
    assert_eq!(source.angular_speed, Some(7.0));
}

#[test]
fn for_an_imu_without_a_clock_the_time_of_its_messages_counts() {
    let mut setup = setup("unset", &[]);
    let source = detections_with_speed(&mut setup, || turn(Stamp::default()));
    assert_eq!(source.angular_speed, Some(7.0));
}

#[test]
fn sigterm_ends_it_with_its_topic_closed_during_any_wait() {
    let mut setup = setup("sigterm", &[]);
    {
        let mut frames = open(&setup.frames, Some(frame::ENCODING), 10_000);
        publish_until_seen(&mut frames, &blank(0), &mut setup);
    }
    setup.detector.terminate();
    let ended = setup.detector.end();
    assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    await_end(&mut setup.detections);
    assert!(!setup.detections.topic().path().exists());
}

#[test]
fn a_detector_takes_over_the_topic_of_a_killed_one() {
    let mut setup = setup("killed", &[]);
    let _camera = Camera::start(&setup.frames);
    let (before, _) = next_message(&mut setup.detections);
    setup.detector.kill();
    let killed_ns = clock::now_ns();
    setup.detector = start(&setup.frames, &setup.imu, setup.detections.topic(), &[]);
    loop {
        let (meta, message) = next_message(&mut setup.detections);
        assert!(meta.sequence > before.sequence && meta.lost == 0);
        let published = TagDetections::decode(&message).expect("detections");
        if published.source.expect("a frame").capture_time_ns > killed_ns {
            return;
        }
    }
}

#[test]
fn it_releases_the_topics_that_it_read_when_it_ends() {
    let setup = setup("let_go", &[]);
    let _frames = open(&setup.frames, Some(frame::ENCODING), 10_000);
    let mut samples = open(&setup.imu, Some(imu::ENCODING), 1000);
    let topics = [setup.frames.clone(), setup.imu.clone()];
    let readers = || {
        topics
            .each_ref()
            .map(|topic| Info::read(topic).expect("a topic").readers.len())
    };
    let deadline = Instant::now() + PATIENCE;
    while readers() != [1, 1] {
        assert!(Instant::now() < deadline, "it does not subscribe");
        samples.publish(&Imu::default().encode()).expect("it fits");
        thread::sleep(Duration::from_millis(1));
    }
    end(setup.detector);
    assert_eq!(readers(), [0, 0]);
}

#[test]
fn the_end_of_stdin_ends_it_with_exit_with_stdin() {
    let mut setup = setup("stdin", &["--exit-with-stdin"]);
    let _camera = Camera::start(&setup.frames);
    setup.next_detections();
    setup.detector.close_stdin();
    let ended = setup.detector.end();
    assert_eq!(ended.status, Some(0), "{}", ended.stderr);
    assert!(!setup.detections.topic().path().exists());
}

#[test]
fn help_exits_with_status_0() {
    let ended = call(VISION_TAGS, &["--help"]);
    assert_eq!(
        (ended.status, ended.stdout.as_str()),
        (Some(0), vision_tags::options::HELP)
    );
}

#[test]
fn a_usage_error_is_one_line_and_status_2() {
    let family = ["--frames", "f", "--detections", "d", "--family", "tag9h9"];
    for arguments in [
        &family[..],
        &["--nonsense"],
        &[],
        &["--frames", "a", "--detections", "a"],
    ] {
        let ended = call(VISION_TAGS, arguments);
        assert_eq!(ended.status, Some(2), "{arguments:?}");
        assert!(printed_one_line(&ended, "vision_tags"), "{ended:?}");
    }
}

#[test]
fn a_detections_topic_with_a_live_publisher_is_one_line_and_status_1() {
    let (frames, taken) = (unique_topic("free"), unique_topic("taken"));
    let _publisher = Publisher::open(&taken, &PublisherOptions::default()).unwrap();
    let ended = call(
        VISION_TAGS,
        &["--frames", frames.name(), "--detections", taken.name()],
    );
    assert_eq!(ended.status, Some(1));
    assert!(printed_one_line(&ended, "vision_tags"), "{ended:?}");
    assert!(ended.stderr.contains(taken.name()), "{ended:?}");
}

#[test]
fn a_removed_topic_is_created_again_while_no_frame_arrives() {
    let setup = setup("removed", &[]);
    let path = setup.detections.topic().path().to_owned();
    let deadline = Instant::now() + PATIENCE;
    let await_file = || {
        while !path.exists() {
            assert!(Instant::now() < deadline, "there is no topic");
            thread::sleep(Duration::from_millis(10));
        }
    };
    await_file();
    std::fs::remove_file(&path).expect("a topic");
    await_file();
}
