//! `ganglion topics`: all topics of this machine.

use super::Verb;
use crate::options::Options;
use crate::output::{Output, Record, or_dash};
use crate::{content, state, units, world};
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

  --prefix NAME    only topics whose names begin so
  --look SECONDS   how long to look in order to tell the rates, 0.01 to 3600; default 1
  --json           one JSON object a line, for each topic
  --help           this text

State is live, dead (the publisher died; the next one goes on in place), closed, retired (replaced by one of another
geometry), legacy (made by a publisher that does not say whether it lives) or broken. A rate is that of the messages that
came during the look; a topic slower than the look shows 0 or has a rate, as it comes. Age is that of the last message.
Slots are their number times their length, of which 20 bytes are the ring's own.
";

const HEAD: &str = "TOPIC\tSTATE\tPID\tRATE\tPUBLISHED\tAGE\tREADERS\tSLOTS\tCONTENT";

fn run(options: &Options, output: &mut Output, _log: Log) -> Result<(), Failure> {
    let before: Vec<Look> = names(&options.prefix)?.filter_map(Look::take).collect();
    if !before.is_empty() && output.stop().wait_until(Instant::now() + options.look) {
        return Ok(());
    }
    let rows = before.into_iter().filter_map(|first| {
        let second = Look::take(first.topic.clone())?;
        Some(Row::new(&first, second))
    });
    output.put_table(HEAD, &rows.collect::<Vec<_>>())
}

/// The topics that there are.
fn names(prefix: &str) -> Result<impl Iterator<Item = Topic>, Failure> {
    let topics = Listing::read().map_err(world)?.topics;
    Ok(topics
        .into_iter()
        .filter(move |topic| topic.name().starts_with(prefix)))
}

/// A topic at one moment.
struct Look {
    topic: Topic,
    at_ns: u64,
    info: Result<Info, Error>,
}

impl Look {
    /// `None` when the topic is not there any more.
    fn take(topic: Topic) -> Option<Look> {
        let info = Info::read(&topic);
        let at_ns = clock::now_ns();
        match info {
            Err(Error::NoTopic { .. }) => None,
            info => Some(Look { topic, at_ns, info }),
        }
    }
}

struct Row {
    look: Look,
    rate_hz: Option<f64>,
}

impl Row {
    fn new(before: &Look, look: Look) -> Row {
        let rate_hz = match (&before.info, &look.info) {
            (Ok(first), Ok(second)) => rate(first, second, look.at_ns - before.at_ns),
            _ => None,
        };
        Row { look, rate_hz }
    }

    fn age_s(&self, info: &Info) -> Option<f64> {
        let last = (info.last_publish_ns > 0).then_some(info.last_publish_ns)?;
        Some(units::age_s(self.look.at_ns, last))
    }
}

/// Messages a second from one look to another: by the time stamps of the last messages, else by the time between the looks.
/// `None` if they are not of one and the same ring.
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

/// The publisher's process, if it says so.
fn pid(info: &Info) -> Option<u32> {
    (info.state != State::Legacy && info.writer_pid > 0).then_some(info.writer_pid)
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.look.topic.name();
        let info = match &self.look.info {
            Ok(info) => info,
            Err(error) => return write!(f, "{name}\tbroken\t-\t-\t-\t-\t-\t-\t{}", fault(error)),
        };
        write!(
            f,
            "{name}\t{}\t{}\t{}\t{}\t{}\t{}\t{} × {}\t{}",
            state::name(info.state),
            or_dash(pid(info)),
            or_dash(self.rate_hz.map(units::rate)),
            info.published,
            or_dash(self.age_s(info).map(units::span)),
            info.readers.len(),
            info.geometry.slot_count(),
            info.geometry.slot_size(),
            content::name(info.content)
        )
    }
}

/// What is wrong, without the path.
fn fault(error: &Error) -> String {
    match error {
        Error::BadSegment { fault, .. } => fault.to_string(),
        Error::Os { source, .. } => source.to_string(),
        other => other.to_string(),
    }
}

impl Record for Row {
    fn json(&self) -> Value {
        let name = self.look.topic.name();
        let info = match &self.look.info {
            Ok(info) => info,
            Err(error) => return json!({"topic": name, "state": "broken", "fault": fault(error)}),
        };
        json!({
            "topic": name,
            "state": state::name(info.state),
            "pid": pid(info),
            "rate_hz": self.rate_hz.map(|rate| units::rounded(rate, 4)),
            "published": info.published,
            "age_s": self.age_s(info).map(|age| units::rounded(age, 6)),
            "readers": info.readers.len(),
            "slot_count": info.geometry.slot_count(),
            "slot_size": info.geometry.slot_size(),
            "max_message_size": info.geometry.max_message_size(),
            "content": content::name(info.content),
        })
    }
}
