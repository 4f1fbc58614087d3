//! `ganglion topics`: lists the topics of this machine.

use crate::options::Options;
use crate::output::{Output, Record, or_dash};
use crate::verb::Verb;
use crate::{failure, names, units};
use conduit_ring::{Error, Info, Listing, State, Topic, clock};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::time::Instant;

pub const VERB: Verb = Verb {
    name: "topics",
    summary: "all topics of this machine",
    help: HELP,
    takes_topic: false,
    options: &["--prefix", "--look", "--json", "--help"],
    run,
};

const HELP: &str = "\
ganglion topics: lists all ring topics of this machine

Usage: ganglion topics [options]

  --prefix NAME    only topics whose names start with NAME
  --look SECONDS   time over which rates are measured, 0.01 to 3600; default 1
  --json           print one JSON object per line, for each topic
  --help           print this help

STATE is live, dead (the publisher died; the next one takes over), closed, retired (replaced by
a topic of another geometry), legacy (from a publisher without a lock, so that its life cannot
be checked) or broken. RATE counts the messages during the measurement; a topic with a longer
period may show 0. AGE is the age of the last message. SLOTS is their number and size in bytes,
of which 20 are the ring's header.
";

const HEAD: &str = "TOPIC\tSTATE\tPID\tRATE\tPUBLISHED\tAGE\tREADERS\tSLOTS\tCONTENT";

fn run(options: &Options, output: &mut Output, _log: Log) -> Result<(), Failure> {
    let before: Vec<Sample> = topics(&options.prefix)?.filter_map(Sample::take).collect();
    if !before.is_empty() && output.stop().wait_until(Instant::now() + options.look) {
        return Ok(());
    }
    let rows = before.into_iter().filter_map(|first| {
        let second = Sample::take(first.topic.clone())?;
        Some(Row::new(&first, second))
    });
    output.put_table(HEAD, &rows.collect::<Vec<_>>())
}

/// Returns the topics whose names start with `prefix`.
fn topics(prefix: &str) -> Result<impl Iterator<Item = Topic>, Failure> {
    let topics = Listing::read().map_err(failure::runtime)?.topics;
    Ok(topics
        .into_iter()
        .filter(move |topic| topic.name().starts_with(prefix)))
}

/// The state of a topic at one time.
struct Sample {
    topic: Topic,
    at_ns: u64,
    info: Result<Info, Error>,
}

impl Sample {
    /// Reads a topic's state, or returns `None` when the topic no longer exists.
    fn take(topic: Topic) -> Option<Sample> {
        let info = Info::read(&topic);
        let at_ns = clock::now_ns();
        match info {
            Err(Error::NoTopic { .. }) => None,
            info => Some(Sample { topic, at_ns, info }),
        }
    }
}

struct Row {
    sample: Sample,
    rate_hz: Option<f64>,
}

impl Row {
    fn new(before: &Sample, sample: Sample) -> Row {
        let rate_hz = match (&before.info, &sample.info) {
            (Ok(first), Ok(second)) => rate(first, second, sample.at_ns - before.at_ns),
            _ => None,
        };
        Row { sample, rate_hz }
    }

    fn age_s(&self, info: &Info) -> Option<f64> {
        let last = (info.last_publish_ns > 0).then_some(info.last_publish_ns)?;
        Some(units::age_s(self.sample.at_ns, last))
    }
}

/// Returns the messages per second between two samples: by the timestamps of the last messages,
/// or else by the time between the samples. Returns `None` if the samples are of different rings.
fn rate(first: &Info, second: &Info, between_ns: u64) -> Option<f64> {
    if first.instance_id != second.instance_id {
        return None;
    }
    let messages = second.published.checked_sub(first.published)?;
    let stamped_ns = second.last_publish_ns.saturating_sub(first.last_publish_ns);
    let span_ns = if first.last_publish_ns > 0 && stamped_ns > 0 {
        stamped_ns
    } else {
        between_ns
    };
    Some(messages as f64 / units::seconds(span_ns.max(1)))
}

/// Returns the publisher's process id if the publisher wrote it.
fn pid(info: &Info) -> Option<u32> {
    (info.state != State::Legacy && info.writer_pid > 0).then_some(info.writer_pid)
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.sample.topic.name();
        let info = match &self.sample.info {
            Ok(info) => info,
            Err(error) => return write!(f, "{name}\tbroken\t-\t-\t-\t-\t-\t-\t{}", fault(error)),
        };
        write!(
            f,
            "{name}\t{}\t{}\t{}\t{}\t{}\t{}\t{} × {}\t{}",
            names::state(info.state),
            or_dash(pid(info)),
            or_dash(self.rate_hz.map(units::rate)),
            info.published,
            or_dash(self.age_s(info).map(units::span)),
            info.readers.len(),
            info.geometry.slot_count(),
            info.geometry.slot_size(),
            names::encoding(info.content)
        )
    }
}

/// Describes an error without the path.
fn fault(error: &Error) -> String {
    match error {
        Error::BadSegment { fault, .. } => fault.to_string(),
        Error::Os { source, .. } => source.to_string(),
        other => other.to_string(),
    }
}

impl Record for Row {
    fn json(&self) -> Value {
        let name = self.sample.topic.name();
        let info = match &self.sample.info {
            Ok(info) => info,
            Err(error) => return json!({"topic": name, "state": "broken", "fault": fault(error)}),
        };
        json!({
            "topic": name,
            "state": names::state(info.state),
            "pid": pid(info),
            "rate_hz": self.rate_hz.map(|rate| units::rounded(rate, 4)),
            "published": info.published,
            "age_s": self.age_s(info).map(|age| units::rounded(age, 6)),
            "readers": info.readers.len(),
            "slot_count": info.geometry.slot_count(),
            "slot_size": info.geometry.slot_size(),
            "max_message_size": info.geometry.max_message_size(),
            "content": names::encoding(info.content),
        })
    }
}
