//! Watching a topic: its messages, and what becomes of its publisher.

use crate::options::Options;
use crate::output::{Output, Record};
use crate::{absent, process, world};
use conduit_ring::{ContentTag, Incarnation, Meta, Observer, ObserverOptions, Read};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::thread;
use std::time::{Duration, Instant};

/// The longest time without a look whether to stop.
const PATIENCE: Duration = Duration::from_millis(200);

/// How often a new publisher is given a millisecond to write down who it is.
const INTRODUCTIONS: u32 = 50;

/// What was seen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Sight {
    /// A message; its bytes are [`Watch::message`].
    Message(Meta),
    /// The publisher is another one, or gone.
    Change(Change),
    /// Nothing, so far.
    Nothing,
}

/// What became of a topic's publisher.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    topic: String,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Down,
    Up {
        publisher: Incarnation,
        previous: Option<Incarnation>,
    },
}

/// A topic that is being watched, without a reader slot.
pub struct Watch {
    observer: Observer,
    buffer: Vec<u8>,
    publisher: Option<Incarnation>,
}

impl Watch {
    /// Begins to watch. Says so if there is no publisher to watch yet.
    pub fn open(options: &Options, watching: &ObserverOptions, log: Log) -> Result<Watch, Failure> {
        let topic = options.topic();
        if !options.wait {
            absent::refuse(topic)?;
        }
        let observer = Observer::open(topic, watching).map_err(world)?;
        if !observer.publisher_up() {
            log.line(format_args!("waiting for a publisher of {}", topic.name()));
        }
        Ok(Watch {
            publisher: observer.incarnation(),
            observer,
            buffer: Vec::new(),
        })
    }

    /// The next thing to be seen before `deadline`. Ends early, with nothing, when it is time to look whether to stop.
    pub fn next(&mut self, deadline: Instant) -> Result<Sight, Failure> {
        if self.observer.publisher_up() && self.observer.incarnation() != self.publisher {
            return Ok(self.introduce());
        }
        let patience = deadline
            .saturating_duration_since(Instant::now())
            .min(PATIENCE);
        let read = self.observer.read_timeout(&mut self.buffer, patience);
        Ok(match read.map_err(world)? {
            Read::Message(meta) => Sight::Message(meta),
            Read::Nothing => Sight::Nothing,
            Read::PublisherUp => self.introduce(),
            Read::PublisherDown => self.change(Kind::Down),
        })
    }

    /// Tells who publishes now. A publisher takes its lock first and says then who it is.
    fn introduce(&mut self) -> Sight {
        for _ in 0..INTRODUCTIONS {
            let changed = self.observer.incarnation() != self.publisher;
            thread::sleep(Duration::from_millis(1));
            if changed {
                break;
            }
        }
        let previous = self.publisher;
        self.publisher = self.observer.incarnation();
        match self.publisher {
            Some(publisher) => self.change(Kind::Up {
                publisher,
                previous,
            }),
            None => Sight::Nothing,
        }
    }

    fn change(&self, kind: Kind) -> Sight {
        Sight::Change(Change {
            topic: self.observer.topic().name().to_owned(),
            kind,
        })
    }

    /// The bytes of the message that was seen last.
    pub fn message(&self) -> &[u8] {
        &self.buffer
    }

    /// What its messages are.
    pub fn content(&self) -> ContentTag {
        self.observer.content().unwrap_or_default()
    }

    /// How the topic's publisher stands: `up`, `down`, or `absent` while there is no topic.
    pub fn publisher(&self) -> &'static str {
        match (self.observer.publisher_up(), self.observer.incarnation()) {
            (true, _) => "up",
            (false, Some(_)) => "down",
            (false, None) => "absent",
        }
    }
}

/// Shows sights to `see`, and the changes to whoever reads the output, until `see` has had enough, which it says by `false`,
/// or whoever started this has.
pub fn until_enough(
    watch: &mut Watch,
    output: &mut Output,
    mut see: impl FnMut(&Watch, Sight, &mut Output) -> Result<Next, Failure>,
) -> Result<(), Failure> {
    let mut next = Next::By(Instant::now());
    while let Next::By(deadline) = next
        && !output.stopped()
    {
        let sight = watch.next(deadline)?;
        if let Sight::Change(change) = &sight {
            output.put(change)?;
        }
        next = see(watch, sight, output)?;
    }
    Ok(())
}

/// What is to come after a sight.
pub enum Next {
    /// Another one, or nothing by then.
    By(Instant),
    /// None.
    Enough,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind {
            Kind::Down => f.write_str("-- the publisher is gone"),
            Kind::Up {
                publisher,
                previous,
            } => {
                let verb = if previous.is_some() {
                    "restarted"
                } else {
                    "came"
                };
                write!(
                    f,
                    "-- the publisher {verb}: {}",
                    process::label(publisher.pid)
                )
            }
        }
    }
}

impl Record for Change {
    fn json(&self) -> Value {
        match self.kind {
            Kind::Down => json!({"event": "publisher_down", "topic": self.topic}),
            Kind::Up {
                publisher,
                previous,
            } => json!({
                "event": "publisher_up",
                "topic": self.topic,
                "pid": publisher.pid,
                "epoch": publisher.epoch,
                "restarted": previous.is_some(),
            }),
        }
    }
}
