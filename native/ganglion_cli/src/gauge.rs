//! What `hz`, `bw` and `latency` have in common: they watch, and say each second what they have measured.

use crate::options::Options;
use crate::output::{Output, Record};
use crate::units;
use crate::watch::{self, Next, Sight, Watch};
use conduit_ring::{Meta, ObserverOptions, clock};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::time::{Duration, Instant};

/// A silence that a line speaks of, seconds.
const LONG_SILENCE_S: f64 = 1.0;

/// The options of a verb that is a gauge.
pub const OPTIONS: &[&str] = &[
    "--every", "--window", "--count", "--wait", "--json", "--help",
];

/// Something that is measured of a stream of messages. Times are on the ring's clock.
pub trait Gauge {
    /// What it is called in JSON.
    const EVENT: &'static str;
    /// Takes a message that was seen now.
    fn message(&mut self, meta: &Meta, now_ns: u64);
    /// Takes notice that the publisher changed: what comes next does not follow what came before.
    fn interrupt(&mut self) {}
    /// What it has measured by now.
    fn reading(&mut self, now_ns: u64) -> Reading;
}

/// What a gauge says: the same as text and as the fields of a JSON object.
pub struct Reading {
    /// For people.
    pub text: String,
    /// For programs.
    pub fields: Value,
}

/// One line of a gauge.
struct Line {
    event: &'static str,
    topic: String,
    publisher: &'static str,
    silent_s: Option<f64>,
    reading: Reading,
}

/// Watches a topic with a gauge until it is stopped or has said enough.
pub fn run<G: Gauge>(
    mut gauge: G,
    options: &Options,
    watching: &ObserverOptions,
    output: &mut Output,
    log: Log,
) -> Result<(), Failure> {
    let topic = options.topic();
    let mut watch = Watch::open(options, watching, log)?;
    let mut ticks = Ticks::new(options.every, options.count);
    let mut last_seen_ns = None;
    watch::until_enough(&mut watch, output, |watch, sight, output| {
        let now_ns = clock::now_ns();
        match sight {
            Sight::Message(meta) => {
                gauge.message(&meta, now_ns);
                last_seen_ns = Some(now_ns);
            }
            Sight::Change(_) => gauge.interrupt(),
            Sight::Nothing => {}
        }
        if ticks.is_due() {
            output.put(&Line {
                event: G::EVENT,
                topic: topic.name().to_owned(),
                publisher: watch.publisher(),
                silent_s: last_seen_ns.map(|last| units::age_s(now_ns, last)),
                reading: gauge.reading(now_ns),
            })?;
            ticks.advance();
        }
        Ok(ticks.next())
    })
}

/// When a line is due.
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
            Some(0) => Next::Enough,
            _ => Next::By(self.deadline),
        }
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reading.text)?;
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
        if let (Some(line), Some(fields)) = (line.as_object_mut(), self.reading.fields.as_object())
        {
            line.extend(fields.clone());
        }
        line
    }
}
