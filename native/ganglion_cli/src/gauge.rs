//! The loop that `hz`, `bw` and `latency` share: watch a topic and print a line at intervals.

use crate::options::Options;
use crate::output::{Output, Record};
use crate::units;
use crate::watch::{self, Event, Next, Watch};
use conduit_ring::{Meta, ObserverOptions, clock};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::time::{Duration, Instant};

/// The silence in seconds from which a line mentions it.
const LONG_SILENCE_S: f64 = 1.0;

/// The options of a verb that measures.
pub const OPTIONS: &[&str] = &[
    "--every", "--window", "--count", "--wait", "--json", "--help",
];

/// A measurement of a topic's messages. Times are those of the ring's clock.
pub trait Gauge {
    /// The event's name in JSON.
    const EVENT: &'static str;
    /// Records a message that was read at `now_ns`.
    fn record(&mut self, meta: &Meta, now_ns: u64);
    /// Handles a change of the publisher: the next message does not follow the previous one.
    fn interrupt(&mut self) {}
    /// Returns the result up to now.
    fn measurement(&mut self, now_ns: u64) -> Measurement;
}

/// The result of a gauge as text and as the fields of a JSON object.
pub struct Measurement {
    /// For people.
    pub text: String,
    /// For programs.
    pub fields: Value,
}

/// One line of output.
struct Line {
    event: &'static str,
    topic: String,
    publisher: &'static str,
    silent_s: Option<f64>,
    measurement: Measurement,
}

/// Watches a topic with a gauge until a stop is requested or enough lines are printed.
pub fn run<G: Gauge>(
    mut gauge: G,
    options: &Options,
    observing: &ObserverOptions,
    output: &mut Output,
    log: Log,
) -> Result<(), Failure> {
    let topic = options.topic();
    let mut watch = Watch::open(options, observing, log)?;
    let mut ticks = Ticks::new(options.every, options.count);
    let mut last_message_ns = None;
    watch::for_each(&mut watch, output, |watch, event, output| {
        let now_ns = clock::now_ns();
        match event {
            Event::Message(meta) => {
                gauge.record(&meta, now_ns);
                last_message_ns = Some(now_ns);
            }
            Event::Change(_) => gauge.interrupt(),
            Event::Nothing => {}
        }
        if ticks.is_due() {
            output.put(&Line {
                event: G::EVENT,
                topic: topic.name().to_owned(),
                publisher: watch.publisher(),
                silent_s: last_message_ns.map(|last| units::age_s(now_ns, last)),
                measurement: gauge.measurement(now_ns),
            })?;
            ticks.advance();
        }
        Ok(ticks.next())
    })
}

/// The times at which a line is due.
struct Ticks {
    deadline: Instant,
    every: Duration,
    left: Option<u64>,
}

impl Ticks {
    fn new(every: Duration, count: Option<u64>) -> Ticks {
        Ticks {
            deadline: Instant::now() + every,
            every,
            left: count,
        }
    }

    fn is_due(&self) -> bool {
        Instant::now() >= self.deadline
    }

    fn advance(&mut self) {
        self.deadline = (self.deadline + self.every).max(Instant::now());
        self.left = self.left.map(|left| left - 1);
    }

    fn next(&self) -> Next {
        match self.left {
            Some(0) => Next::End,
            _ => Next::Until(self.deadline),
        }
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.measurement.text)?;
        if self.publisher != "up" {
            write!(f, "  publisher {}", self.publisher)?;
        }
        match self.silent_s {
            Some(s) if s >= LONG_SILENCE_S => write!(f, "  silent for {}", units::span(s)),
            _ => Ok(()),
        }
    }
}

impl Record for Line {
    fn json(&self) -> Value {
        let mut line = json!({
            "event": self.event,
            "topic": self.topic,
            "publisher": self.publisher,
            "silent_s": self.silent_s.map(|s| units::rounded(s, 3)),
        });
        let fields = self.measurement.fields.as_object();
        if let (Some(line), Some(fields)) = (line.as_object_mut(), fields) {
            line.extend(fields.clone());
        }
        line
    }
}
