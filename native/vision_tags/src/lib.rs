//! A process that sees AprilTags: frames come in on one ring topic, detections go out on another.
//!
//! It looks at the newest frame and skips those that came while it was busy, so that what it says is always fresh. Each
//! frame that was looked at gives one message, also when no tag is in it. Beside the tags stands how fast the robot
//! turned when the frame was captured, if an inertial unit's topic was given: a picture taken in a fast turn deserves
//! less trust.
//!
//! Camera and inertial unit may come later, go and come back. A frame that cannot be used is counted, complained about
//! once in a while, and skipped. The library is the program; `main` only calls it.

pub mod complaint;
pub mod eye;
pub mod gyro;
pub mod motion;
pub mod options;

use complaint::Complaints;
use conduit_ring::{
    ContentTag, Geometry, Meta, Policy, Publisher, PublisherOptions, Read, Subscriber,
    SubscriberOptions, Topic, clock,
};
use eye::{Eye, LookError};
use ganglion_messages::frame::{self, CLOCK_MONOTONIC_RAW, Frame, FrameError, FrameHeader};
use ganglion_messages::stamp::Stamp;
use ganglion_messages::tags::{self, FrameSource, TagDetection, TagDetections, largest_message};
use gyro::Gyro;
use options::Options;
use program::stop::Stop;
use program::{Failure, Log};
use std::fmt;
use std::time::{Duration, Instant};

/// The most tags in a message; of more the clearest are kept.
pub const MOST_DETECTIONS: usize = 64;

/// Messages that the ring of detections holds.
const DEPTH: u32 = 16;

const LONGEST_FAMILY: usize = 16;
const LONGEST_TOPIC: usize = 200;
/// Between two looks after the detections' topic, whatever comes of the frames.
const LOOKS: Duration = Duration::from_millis(250);
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(100);

/// Why a message of the frames' topic was not looked at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refusal {
    /// The topic says that its messages are something else: its content tag.
    NotFrames(u64),
    /// The message is not a frame.
    Frame(FrameError),
    /// The frame cannot be looked at.
    Look(LookError),
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refusal::NotFrames(tag) => write!(
                f,
                "its content tag {tag:016x} is not that of {}",
                frame::ENCODING
            ),
            Refusal::Frame(error) => error.fmt(f),
            Refusal::Look(error) => error.fmt(f),
        }
    }
}

/// Looks for tags until the stop is requested.
///
/// # Errors
/// A detections' topic that has a live publisher; a topic that cannot be opened.
pub fn run(options: &Options, stop: &Stop, log: Log) -> Result<(), Failure> {
    let publisher = publisher(&options.detections)?;
    let frames = subscriber(&options.frames)?;
    let waker = frames.waker();
    stop.on_request(move || waker.wake());
    let gyro = gyro(options.imu.as_ref(), stop, log)?;
    log.line(format_args!(
        "looking for {} on ring topic {:?}, telling on {:?}",
        options.settings.family,
        options.frames.name(),
        options.detections.name()
    ));
    let mut watch = Watch {
        eye: Eye::new(options.settings.clone()),
        frames,
        gyro,
        publisher,
        next_look: Instant::now(),
        log,
        refused: Complaints::default(),
        troubles: Complaints::default(),
        looked_at: 0,
        message: Vec::new(),
        report: Vec::new(),
    };
    watch.until(stop);
    log.line(format_args!(
        "stopped after {} frames, {} refused",
        watch.looked_at,
        watch.refused.total()
    ));
    watch.gyro.join();
    Ok(())
}

fn gyro(topic: Option<&Topic>, stop: &Stop, log: Log) -> Result<Gyro, Failure> {
    let Some(topic) = topic else {
        return Ok(Gyro::default());
    };
    Gyro::follow(topic, stop, log)
        .map_err(|error| Failure::Runtime(format!("no thread can be started: {error}")))
}

fn publisher(topic: &Topic) -> Result<Publisher, Failure> {
    let largest = largest_message(MOST_DETECTIONS, LONGEST_FAMILY, LONGEST_TOPIC);
    let options = PublisherOptions {
        geometry: Geometry::depth(DEPTH, largest as u32).map_err(world)?,
        content: ContentTag::of(tags::ENCODING),
        ..PublisherOptions::default()
    };
    Publisher::open(topic, &options).map_err(world)
}

fn subscriber(topic: &Topic) -> Result<Subscriber, Failure> {
    let options = SubscriberOptions {
        policy: Policy::Latest,
        ..SubscriberOptions::default()
    };
    Subscriber::open(topic, &options).map_err(world)
}

fn world(error: impl std::error::Error) -> Failure {
    Failure::Runtime(error.to_string())
}

/// The watch over the frames.
struct Watch {
    eye: Eye,
    frames: Subscriber,
    gyro: Gyro,
    publisher: Publisher,
    next_look: Instant,
    log: Log,
    refused: Complaints,
    troubles: Complaints,
    looked_at: u64,
    message: Vec<u8>,
    report: Vec<u8>,
}

impl Watch {
    fn until(&mut self, stop: &Stop) {
        while !stop.requested() {
            self.look_after_topic();
            let read = self.frames.read_timeout(&mut self.message, LOOKS);
            match read {
                Ok(Read::Message(meta)) => self.take(meta),
                Ok(Read::PublisherUp) => self.log.line("the camera is there"),
                Ok(Read::PublisherDown) => self.log.line("the camera is gone"),
                Ok(Read::Nothing) => {}
                Err(error) => {
                    complain(self.log, &mut self.troubles, error);
                    stop.wait_until(Instant::now() + PAUSE_AFTER_ERROR);
                }
            }
        }
    }

    /// What a look finds wrong is told by the next detections.
    fn look_after_topic(&mut self) {
        let now = Instant::now();
        if now >= self.next_look {
            self.next_look = now + LOOKS;
            let _ = self.publisher.look_after();
        }
    }

    fn take(&mut self, meta: Meta) {
        match self.look(meta) {
            Ok(detections) => self.tell(&detections),
            Err(refusal) => {
                let name = self.frames.topic().name();
                let what = format!("a message of ring topic {name:?} was refused: {refusal}");
                complain(self.log, &mut self.refused, what);
            }
        }
    }

    fn look(&mut self, meta: Meta) -> Result<TagDetections, Refusal> {
        check_content(self.frames.content())?;
        let frame = Frame::decode(&self.message).map_err(Refusal::Frame)?;
        let detections = self.eye.look(&frame).map_err(Refusal::Look)?;
        let capture_time_ns = capture_time_ns(&frame.header, meta.timestamp_ns);
        Ok(TagDetections {
            stamp: wall_time(capture_time_ns, clock::realtime_offset_ns()),
            frame_id: self.frames.topic().name().to_owned(),
            detections: clearest(detections, MOST_DETECTIONS),
            source: Some(FrameSource {
                frame_sequence: meta.sequence,
                frame_id: frame.header.frame_id,
                image_width: frame.header.width,
                image_height: frame.header.height,
                capture_time_ns,
                angular_speed: self.gyro.angular_speed_at(capture_time_ns),
            }),
        })
    }

    fn tell(&mut self, detections: &TagDetections) {
        self.looked_at += 1;
        detections.encode_into(&mut self.report);
        if let Err(error) = self.publisher.publish(&self.report) {
            let why = self
                .publisher
                .trouble()
                .map(|trouble| format!(": {trouble}"));
            let what = format!("{error}{}", why.unwrap_or_default());
            complain(self.log, &mut self.troubles, what);
        }
    }
}

fn complain(log: Log, complaints: &mut Complaints, what: impl fmt::Display) {
    if let Some(line) = complaints.add(Instant::now(), what) {
        log.line(line);
    }
}

/// A camera that does not state its encoding is believed; what it sends is checked anyway.
fn check_content(content: Option<ContentTag>) -> Result<(), Refusal> {
    match content {
        Some(tag) if tag != ContentTag::RAW && tag != ContentTag::of(frame::ENCODING) => {
            Err(Refusal::NotFrames(tag.value()))
        }
        _ => Ok(()),
    }
}

/// When a frame was captured by `CLOCK_MONOTONIC_RAW`: as its header says, or when it was published if the header tells
/// the time by another clock.
fn capture_time_ns(header: &FrameHeader, published_ns: u64) -> u64 {
    match header.clock_id {
        CLOCK_MONOTONIC_RAW => header.timestamp_ns,
        _ => published_ns,
    }
}

fn wall_time(time_ns: u64, realtime_offset_ns: i64) -> Stamp {
    let time_ns = i64::try_from(time_ns).unwrap_or(i64::MAX);
    Stamp::from_unix_ns(time_ns.saturating_add(realtime_offset_ns))
}

/// At most so many, the clearest, in their order.
fn clearest(mut detections: Vec<TagDetection>, most: usize) -> Vec<TagDetection> {
    let margin = |index: &usize| detections[*index].decision_margin;
    let mut ranking: Vec<usize> = (0..detections.len()).collect();
    ranking.sort_by(|one, other| margin(other).total_cmp(&margin(one)));
    ranking.truncate(most);
    let mut index = 0..;
    detections.retain(|_| index.next().is_some_and(|index| ranking.contains(&index)));
    detections
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tag(id: i32, decision_margin: f32) -> TagDetection {
        TagDetection {
            id,
            decision_margin,
            ..TagDetection::default()
        }
    }

    #[test]
    fn of_too_many_tags_the_clearest_are_kept_in_their_order() {
        let tags = vec![tag(0, 5.0), tag(1, 1.0), tag(2, 5.0), tag(3, 9.0)];
        let ids = |most| -> Vec<i32> {
            let kept = clearest(tags.clone(), most);
            kept.iter().map(|tag| tag.id).collect()
        };
        assert_eq!(ids(4), [0, 1, 2, 3]);
        assert_eq!(ids(3), [0, 2, 3]);
        assert_eq!(ids(2), [0, 3]);
        assert_eq!(ids(1), [3]);
    }

    #[test]
    fn frames_and_unstated_messages_are_taken_and_others_refused() {
        assert_eq!(check_content(None), Ok(()));
        assert_eq!(check_content(Some(ContentTag::RAW)), Ok(()));
        assert_eq!(check_content(Some(ContentTag::of("conduit/frame"))), Ok(()));
        let other = ContentTag::of("sensor_msgs/msg/Imu");
        let refusal = Refusal::NotFrames(other.value());
        assert_eq!(check_content(Some(other)), Err(refusal));
    }

    #[test]
    fn the_time_of_capture_is_the_headers_unless_told_by_another_clock() {
        let header = FrameHeader::grey(1, 1, 77, 0);
        assert_eq!(capture_time_ns(&header, 99), 77);
        let foreign = FrameHeader {
            clock_id: 1,
            ..header
        };
        assert_eq!(capture_time_ns(&foreign, 99), 99);
    }

    #[test]
    fn the_wall_time_of_a_hostile_time_stamp_is_no_panic() {
        assert_eq!(wall_time(1_000_000_000, 500).unix_ns(), 1_000_000_500);
        wall_time(u64::MAX, i64::MAX);
        wall_time(0, i64::MIN);
    }

    #[test]
    fn the_largest_message_is_not_too_large_for_a_slot() {
        let detections = TagDetections {
            frame_id: "x".repeat(LONGEST_TOPIC),
            detections: vec![
                TagDetection {
                    family: eye::FAMILIES[0].into(),
                    ..TagDetection::default()
                };
                MOST_DETECTIONS
            ],
            source: Some(FrameSource::default()),
            ..TagDetections::default()
        };
        let largest = largest_message(MOST_DETECTIONS, LONGEST_FAMILY, LONGEST_TOPIC);
        assert!(detections.encode().len() <= largest);
        assert!(
            eye::FAMILIES
                .iter()
                .all(|name| name.len() <= LONGEST_FAMILY)
        );
    }
}
