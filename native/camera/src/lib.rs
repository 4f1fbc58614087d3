//! A camera that is a program: it publishes grey frames on a ring topic, at a set rate.
//!
//! Its frames are either pictures of a rendered [`scene`], in which AprilTags move and of which the truth is known, or
//! [`photographs`] from a folder, one after the other and round again. Frame n of the scene shows it at n / rate seconds,
//! so that whoever knows a frame's number and the rate knows the truth.
//!
//! A frame is stamped (`CLOCK_MONOTONIC_RAW`) when its picture begins to be made, as a real one is when its exposure
//! begins. Frames are numbered from 0 at each start, without gaps: one that came too late is not counted.

pub mod options;
pub mod pace;
pub mod photographs;
pub mod scene;
pub mod source;
pub mod tag;

use conduit_ring::{ContentTag, Geometry, PublishError, Publisher, PublisherOptions, clock};
use ganglion_messages::frame::{self, FrameHeader};
use options::{Options, Picture};
use pace::Pace;
use program::stop::Stop;
use program::{Failure, Log};
use source::Source;
use std::time::{Duration, Instant};

/// Between two looks after the topic while no frame is due.
const LOOKS: Duration = Duration::from_millis(250);

/// Publishes frames until the stop is requested.
///
/// # Errors
/// A picture that cannot be read, before anything is published; a topic that has a live publisher or cannot be made.
pub fn run(options: &Options, stop: &Stop, log: Log) -> Result<(), Failure> {
    let mut source = Source::open(&options.picture, options.rate_hz)?;
    let mut publisher = open(options, source.largest())?;
    log.line(format_args!(
        "publishing {source} at {} Hz on ring topic {:?}",
        options.rate_hz,
        options.topic.name()
    ));
    let count = publish_all(&mut source, &mut publisher, options.rate_hz, stop)?;
    log.line(format_args!("stopped after {count} frames"));
    Ok(())
}

/// Looks whether the pictures can be used, and does nothing with them.
///
/// # Errors
/// The same as [`run`]'s for such pictures.
pub fn check(picture: &Picture) -> Result<(), Failure> {
    Source::open(picture, 1.0).map(drop)
}

fn open(options: &Options, largest: usize) -> Result<Publisher, Failure> {
    let slot_size = u32::try_from(largest + FrameHeader::SIZE)
        .map_err(|_| Failure::Runtime(format!("a frame of {largest} bytes is too large")))?;
    let options_of_ring = PublisherOptions {
        geometry: Geometry::depth(options.slots, slot_size).map_err(world)?,
        content: ContentTag::of(frame::ENCODING),
        ..PublisherOptions::default()
    };
    Publisher::open(&options.topic, &options_of_ring).map_err(world)
}

fn publish_all(
    source: &mut Source,
    publisher: &mut Publisher,
    rate_hz: f64,
    stop: &Stop,
) -> Result<u64, Failure> {
    let mut pace = Pace::new(Instant::now(), rate_hz);
    let mut number = 0;
    while !wait_until(pace.next(Instant::now()), publisher, stop) {
        let timestamp_ns = clock::now_ns();
        let (width, height, pixels) = source.take(number);
        let header = FrameHeader::grey(width, height, timestamp_ns, number as u32);
        match publisher.publish_slices(&[&header.encode(), pixels]) {
            // Who holds an older frame for so long misses this one, as one who is slow does.
            Ok(_) | Err(PublishError::SlotHeld) => {}
            Err(error) => return Err(with_trouble(error, publisher)),
        }
        number += 1;
    }
    Ok(number)
}

/// Waits for the next frame's time, and looks after the topic meanwhile; `true` when the stop is requested before.
///
/// What a look finds wrong is told by the next frame.
fn wait_until(deadline: Instant, publisher: &mut Publisher, stop: &Stop) -> bool {
    loop {
        let look = Instant::now() + LOOKS;
        if stop.wait_until(deadline.min(look)) {
            return true;
        }
        if deadline <= look {
            return false;
        }
        let _ = publisher.look_after();
    }
}

fn with_trouble(error: PublishError, publisher: &Publisher) -> Failure {
    match publisher.trouble() {
        Some(trouble) => Failure::Runtime(format!("{error}: {trouble}")),
        None => world(error),
    }
}

fn world(error: impl std::error::Error) -> Failure {
    Failure::Runtime(error.to_string())
}
