//! A camera program: it publishes grey frames on a ring topic at a set rate.
//!
//! The frames show either a rendered [`scene`], in which AprilTags move along known paths, or the
//! [`photographs`] of a folder, in a loop. Frame n of the scene shows it at n / rate seconds, so
//! that the ground truth follows from a frame's number and the rate.
//!
//! The timestamp of a frame (`CLOCK_MONOTONIC_RAW`) is the moment before its picture is made, as
//! a real camera stamps the start of the exposure. Frames are numbered from 0 at each start,
//! without gaps; a frame that would be a whole period late is skipped and gets no number.

pub mod deadlines;
pub mod options;
pub mod photographs;
pub mod pictures;
pub mod scene;
pub mod tag;

use conduit_ring::{ContentTag, Geometry, PublishError, Publisher, PublisherOptions, clock};
use deadlines::Deadlines;
use ganglion_messages::frame::{self, FrameHeader};
use options::{Options, Picture};
use pictures::Pictures;
use program::stop::Stop;
use program::{Failure, Log};
use std::time::{Duration, Instant};

/// The pause between two checks of the topic while no frame is due.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Publishes frames until the stop is requested.
///
/// # Errors
/// [`Failure::Runtime`] when a picture cannot be read, before anything is published; when the
/// topic has a live publisher or cannot be created.
pub fn run(options: &Options, stop: &Stop, log: Log) -> Result<(), Failure> {
    let mut pictures = Pictures::open(&options.picture, options.rate_hz)?;
    let mut publisher = open(options, pictures.largest())?;
    log.line(format_args!(
        "publishing {pictures} at {} Hz on ring topic {:?}",
        options.rate_hz,
        options.topic.name()
    ));
    let count = publish_all(&mut pictures, &mut publisher, options.rate_hz, stop)?;
    log.line(format_args!("stopped after {count} frames"));
    Ok(())
}

/// Checks whether the pictures can be used, without publishing them.
///
/// # Errors
/// The errors of [`run`] for these pictures.
pub fn check(picture: &Picture) -> Result<(), Failure> {
    Pictures::open(picture, 1.0).map(drop)
}

fn open(options: &Options, largest: usize) -> Result<Publisher, Failure> {
    let slot_size = u32::try_from(largest + FrameHeader::SIZE)
        .map_err(|_| Failure::Runtime(format!("frame of {largest} bytes is too large")))?;
    let options_of_ring = PublisherOptions {
        geometry: Geometry::depth(options.slots, slot_size).map_err(runtime)?,
        content: ContentTag::of(frame::ENCODING),
        ..PublisherOptions::default()
    };
    Publisher::open(&options.topic, &options_of_ring).map_err(runtime)
}

fn publish_all(
    pictures: &mut Pictures,
    publisher: &mut Publisher,
    rate_hz: f64,
    stop: &Stop,
) -> Result<u64, Failure> {
    let mut deadlines = Deadlines::new(Instant::now(), rate_hz);
    let mut number = 0;
    while !wait_until(deadlines.next(Instant::now()), publisher, stop) {
        let timestamp_ns = clock::now_ns();
        let (width, height, pixels) = pictures.take(number);
        let header = FrameHeader::grey(width, height, timestamp_ns, number as u32);
        match publisher.publish_slices(&[&header.encode(), pixels]) {
            // A subscriber that still leases this slot misses the frame, as a slow subscriber
            // does.
            Ok(_) | Err(PublishError::SlotHeld) => {}
            Err(error) => return Err(with_cause(error, publisher)),
        }
        number += 1;
    }
    Ok(number)
}

/// Waits for the next frame's time and checks the topic meanwhile. Returns `true` when the stop
/// is requested first.
///
/// A failed check has no effect here: publishing the next frame returns its error.
fn wait_until(deadline: Instant, publisher: &mut Publisher, stop: &Stop) -> bool {
    loop {
        let check = Instant::now() + CHECK_PERIOD;
        if stop.wait_until(deadline.min(check)) {
            return true;
        }
        if deadline <= check {
            return false;
        }
        let _ = publisher.look_after();
    }
}

fn with_cause(error: PublishError, publisher: &Publisher) -> Failure {
    match publisher.trouble() {
        Some(trouble) => Failure::Runtime(format!("{error}: {trouble}")),
        None => runtime(error),
    }
}

fn runtime(error: impl std::error::Error) -> Failure {
    Failure::Runtime(error.to_string())
}
