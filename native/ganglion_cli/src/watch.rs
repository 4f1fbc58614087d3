//! Watching a topic: its messages and the changes of its publisher.

use crate::options::Options;
use crate::output::{Output, Record};
use crate::{failure, missing_topic, process};
use conduit_ring::{ContentTag, Incarnation, Meta, Observer, ObserverOptions, Read};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::thread;
use std::time::{Duration, Instant};

/// The longest time between two checks for a stop request.
const CHECK_PERIOD: Duration = Duration::from_millis(200);

/// How often to wait a millisecond for a new publisher to write its incarnation.
const INCARNATION_WAITS: u32 = 50;

/// An event on a watched topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// A message; [`Watch::message`] returns its bytes.
    Message(Meta),
    /// The publisher stopped or was replaced.
    Change(Change),
    /// No event yet.
    Nothing,
}

/// A change of a topic's publisher.
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

/// An observed topic. Observing takes no reader slot.
pub struct Watch {
    observer: Observer,
    buffer: Vec<u8>,
    publisher: Option<Incarnation>,
}

impl Watch {
    /// Starts to observe. Logs a line if there is no publisher yet.
    pub fn open(
        options: &Options,
        observing: &ObserverOptions,
        log: Log,
    ) -> Result<Watch, Failure> {
        let topic = options.topic();
        if !options.wait {
            missing_topic::check_exists(topic)?;
        }
        let observer = Observer::open(topic, observing).map_err(failure::runtime)?;
        if !observer.publisher_up() {
            log.line(format_args!("waiting for a publisher of {}", topic.name()));
        }
        Ok(Watch {
            publisher: observer.incarnation(),
            observer,
            buffer: Vec::new(),
        })
    }

    /// Returns the next event before `deadline`. Returns [`Event::Nothing`] early when it is time
    /// to check for a stop request.
    pub fn next(&mut self, deadline: Instant) -> Result<Event, Failure> {
        if self.observer.publisher_up() && self.observer.incarnation() != self.publisher {
            return Ok(self.new_publisher());
        }
        let timeout = deadline
            .saturating_duration_since(Instant::now())
            .min(CHECK_PERIOD);
        let read = self.observer.read_timeout(&mut self.buffer, timeout);
        Ok(match read.map_err(failure::runtime)? {
            Read::Message(meta) => Event::Message(meta),
            Read::Nothing => Event::Nothing,
            Read::PublisherUp => self.new_publisher(),
            Read::PublisherDown => self.change(Kind::Down),
        })
    }

    /// Returns the change to a new publisher. A publisher locks the topic first and writes its
    /// incarnation afterwards.
    fn new_publisher(&mut self) -> Event {
        for _ in 0..INCARNATION_WAITS {
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
            None => Event::Nothing,
        }
    }

    fn change(&self, kind: Kind) -> Event {
        Event::Change(Change {
            topic: self.observer.topic().name().to_owned(),
            kind,
        })
    }

    /// Returns the bytes of the last message.
    pub fn message(&self) -> &[u8] {
        &self.buffer
    }

    /// Returns the encoding of the topic's messages.
    pub fn content(&self) -> ContentTag {
        self.observer.content().unwrap_or_default()
    }

    /// Returns the state of the topic's publisher: `up`, `down`, or `absent` without a topic.
    pub fn publisher(&self) -> &'static str {
        match (self.observer.publisher_up(), self.observer.incarnation()) {
            (true, _) => "up",
            (false, Some(_)) => "down",
            (false, None) => "absent",
        }
    }
}

/// Passes each event to `handle` until `handle` returns [`Next::End`] or a stop is requested.
/// Prints the changes of the publisher.
pub fn for_each(
    watch: &mut Watch,
    output: &mut Output,
    mut handle: impl FnMut(&Watch, Event, &mut Output) -> Result<Next, Failure>,
) -> Result<(), Failure> {
    let mut next = Next::Until(Instant::now());
    while let Next::Until(deadline) = next
        && !output.stopped()
    {
        let event = watch.next(deadline)?;
        if let Event::Change(change) = &event {
            output.put(change)?;
        }
        next = handle(watch, event, output)?;
    }
    Ok(())
}

/// The continuation after an event.
pub enum Next {
    /// Wait for the next event until this time.
    Until(Instant),
    /// End.
    End,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind {
            Kind::Down => f.write_str("-- publisher stopped"),
            Kind::Up {
                publisher,
                previous,
            } => {
                let verb = if previous.is_some() {
                    "restarted"
                } else {
                    "started"
                };
                write!(f, "-- publisher {verb}: {}", process::label(publisher.pid))
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
