//! The detector program: it reads frames from one ring topic and publishes the AprilTags that it
//! finds on another.
//!
//! The detector reads the newest frame and skips frames that arrived while it worked, so that its
//! results are always fresh. It publishes one message per frame, even without a tag. With an
//! inertial measurement unit's topic, the message includes the robot's angular speed at the
//! frame's capture time: a picture taken in a fast turn is less reliable.
//!
//! Camera and inertial measurement unit may start later, stop and start again. A frame that
//! cannot be used is counted, logged at a limited rate and skipped. The library is the program;
//! `main` only calls it.

pub mod detector;
pub mod imu_follower;
pub mod log_limit;
pub mod motion;
pub mod options;
mod rejection;
mod report;

pub use rejection::Rejection;
pub use report::MOST_DETECTIONS;

use conduit_ring::{
    ContentTag, Geometry, Meta, Policy, Publisher, PublisherOptions, Read, Subscriber,
    SubscriberOptions, Topic, clock,
};
use detector::TagDetector;
use ganglion_messages::frame::Frame;
use ganglion_messages::tags::{self, FrameSource, TagDetections};
use imu_follower::ImuFollower;
use log_limit::LogLimit;
use options::Options;
use program::stop::Stop;
use program::{Failure, Log};
use std::fmt;
use std::time::{Duration, Instant};

/// Slots of the detections' ring.
const DEPTH: u32 = 16;

/// The pause between two checks of the detections' topic, with frames or without.
const CHECK_PERIOD: Duration = Duration::from_millis(250);
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(100);

/// Detects tags until the stop is requested.
///
/// # Errors
/// [`Failure::Runtime`] when the detections' topic has a live publisher, or when a topic cannot
/// be opened.
pub fn run(options: &Options, stop: &Stop, log: Log) -> Result<(), Failure> {
    let publisher = publisher(&options.detections)?;
    let frames = subscriber(&options.frames)?;
    let waker = frames.waker();
    stop.on_request(move || waker.wake());
    let imu = follow_imu(options.imu.as_ref(), stop, log)?;
    log.line(format_args!(
        "detecting {} on ring topic {:?}, publishing on {:?}",
        options.settings.family,
        options.frames.name(),
        options.detections.name()
    ));
    let mut worker = Worker {
        detector: TagDetector::new(options.settings.clone()),
        frames,
        imu,
        publisher,
        next_check: Instant::now(),
        log,
        rejections: LogLimit::default(),
        errors: LogLimit::default(),
        detected_frames: 0,
        message: Vec::new(),
        report: Vec::new(),
    };
    worker.run_until(stop);
    log.line(format_args!(
        "stopped after {} frames, {} rejected",
        worker.detected_frames,
        worker.rejections.total()
    ));
    worker.imu.join();
    Ok(())
}

fn follow_imu(topic: Option<&Topic>, stop: &Stop, log: Log) -> Result<ImuFollower, Failure> {
    let Some(topic) = topic else {
        return Ok(ImuFollower::default());
    };
    ImuFollower::start(topic, stop, log)
        .map_err(|error| Failure::Runtime(format!("could not start a thread: {error}")))
}

fn publisher(topic: &Topic) -> Result<Publisher, Failure> {
    let options = PublisherOptions {
        geometry: Geometry::depth(DEPTH, report::LARGEST_MESSAGE as u32).map_err(runtime)?,
        content: ContentTag::of(tags::ENCODING),
        ..PublisherOptions::default()
    };
    Publisher::open(topic, &options).map_err(runtime)
}

fn subscriber(topic: &Topic) -> Result<Subscriber, Failure> {
    let options = SubscriberOptions {
        policy: Policy::Latest,
        ..SubscriberOptions::default()
    };
    Subscriber::open(topic, &options).map_err(runtime)
}

fn runtime(error: impl std::error::Error) -> Failure {
    Failure::Runtime(error.to_string())
}

/// The loop that reads frames and publishes detections.
struct Worker {
    detector: TagDetector,
    frames: Subscriber,
    imu: ImuFollower,
    publisher: Publisher,
    next_check: Instant,
    log: Log,
    rejections: LogLimit,
    errors: LogLimit,
    detected_frames: u64,
    message: Vec<u8>,
    report: Vec<u8>,
}

impl Worker {
    fn run_until(&mut self, stop: &Stop) {
        while !stop.requested() {
            self.check_topic();
            match self.frames.read_timeout(&mut self.message, CHECK_PERIOD) {
                Ok(Read::Message(meta)) => self.handle(meta),
                Ok(Read::PublisherUp) => self.log.line("camera started"),
                Ok(Read::PublisherDown) => self.log.line("camera stopped"),
                Ok(Read::Nothing) => {}
                Err(error) => {
                    log_limited(self.log, &mut self.errors, error);
                    stop.wait_until(Instant::now() + PAUSE_AFTER_ERROR);
                }
            }
        }
    }

    /// Checks the detections' topic when a check is due. A failed check has no effect here:
    /// publishing the next detections returns its error.
    fn check_topic(&mut self) {
        let now = Instant::now();
        if now >= self.next_check {
            self.next_check = now + CHECK_PERIOD;
            let _ = self.publisher.look_after();
        }
    }

    fn handle(&mut self, meta: Meta) {
        match self.detect(meta) {
            Ok(detections) => self.publish(&detections),
            Err(rejection) => {
                let topic = self.frames.topic().name();
                let event = format!("message of ring topic {topic:?} rejected: {rejection}");
                log_limited(self.log, &mut self.rejections, event);
            }
        }
    }

    fn detect(&mut self, meta: Meta) -> Result<TagDetections, Rejection> {
        rejection::check_content(self.frames.content())?;
        let frame = Frame::decode(&self.message).map_err(Rejection::Frame)?;
        let detections = self.detector.detect(&frame).map_err(Rejection::Detect)?;
        let capture_time_ns = report::capture_time_ns(&frame.header, meta.timestamp_ns);
        Ok(TagDetections {
            stamp: report::wall_time(capture_time_ns, clock::realtime_offset_ns()),
            frame_id: self.frames.topic().name().to_owned(),
            detections: report::clearest(detections, MOST_DETECTIONS),
            source: Some(FrameSource {
                frame_sequence: meta.sequence,
                frame_id: frame.header.frame_id,
                image_width: frame.header.width,
                image_height: frame.header.height,
                capture_time_ns,
                angular_speed: self.imu.angular_speed_at(capture_time_ns),
            }),
        })
    }

    fn publish(&mut self, detections: &TagDetections) {
        self.detected_frames += 1;
        detections.encode_into(&mut self.report);
        if let Err(error) = self.publisher.publish(&self.report) {
            let cause = self
                .publisher
                .trouble()
                .map(|trouble| format!(": {trouble}"));
            let event = format!("{error}{}", cause.unwrap_or_default());
            log_limited(self.log, &mut self.errors, event);
        }
    }
}

fn log_limited(log: Log, limit: &mut LogLimit, event: impl fmt::Display) {
    if let Some(line) = limit.count(Instant::now(), event) {
        log.line(line);
    }
}
