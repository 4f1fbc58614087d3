//! `ganglion echo`: prints the messages of a topic.

use crate::decode::{decode, hex};
use crate::options::Options;
use crate::output::{Output, Record};
use crate::verb::Verb;
use crate::watch::{self, Event, Next, Watch};
use crate::{names, render, units};
use conduit_ring::{Meta, ObserverOptions, Start, clock};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::time::{Duration, Instant};

pub const VERB: Verb = Verb {
    name: "echo",
    summary: "prints messages",
    help: HELP,
    takes_topic: true,
    options: &["--count", "--latest", "--raw", "--wait", "--json", "--help"],
    run,
};

const HELP: &str = "\
ganglion echo: prints the messages of a topic

Usage: ganglion echo TOPIC [options]

  --count N   end after N messages
  --latest    start with the newest message that the ring holds instead of the next one
  --raw       print all bytes in hexadecimal, without decoding
  --wait      wait for a topic that does not exist
  --json      print one JSON object per line
  --help      print this help

echo decodes the encodings conduit/frame (the header without the pixels), sensor_msgs/msg/Imu
and apriltag_msgs/msg/AprilTagDetectionArray, as the topic's content tag names them. It prints
the first 256 bytes of other messages, and of messages that do not match their content tag, in
hexadecimal.

Without --wait a topic that does not exist is an error. ganglion continues when the publisher
dies or starts again, and prints a line about it. It takes no reader slot.
";

/// The bytes printed of an undecoded message without `--raw`.
const EXCERPT: usize = 256;
const BYTES_PER_ROW: usize = 16;

fn run(options: &Options, output: &mut Output, log: Log) -> Result<(), Failure> {
    let start = if options.latest {
        Start::Latest
    } else {
        Start::New
    };
    let observing = ObserverOptions {
        start,
        ..ObserverOptions::default()
    };
    let mut watch = Watch::open(options, &observing, log)?;
    let mut left = options.count;
    watch::for_each(&mut watch, output, |watch, event, output| {
        if let Event::Message(meta) = event {
            output.put(&Message::new(watch, meta, options))?;
            left = left.map(|left| left - 1);
        }
        Ok(match left {
            Some(0) => Next::End,
            _ => Next::Until(Instant::now() + Duration::from_secs(1)),
        })
    })
}

/// A message to print.
struct Message {
    topic: String,
    content: String,
    meta: Meta,
    age_s: f64,
    body: Body,
}

enum Body {
    Decoded(Value),
    /// The bytes, or the first of them, and the reason if decoding failed.
    Bytes(Vec<u8>, Option<String>),
}

impl Message {
    fn new(watch: &Watch, meta: Meta, options: &Options) -> Message {
        Message {
            topic: options.topic().name().to_owned(),
            content: names::encoding(watch.content()),
            meta,
            age_s: units::age_s(clock::now_ns(), meta.timestamp_ns),
            body: Body::new(watch, options.raw),
        }
    }
}

impl Body {
    fn new(watch: &Watch, raw: bool) -> Body {
        let bytes = watch.message();
        if raw {
            return Body::Bytes(bytes.to_vec(), None);
        }
        match decode(watch.content(), bytes) {
            Some(Ok(fields)) => Body::Decoded(fields),
            Some(Err(reason)) => Body::Bytes(excerpt(bytes), Some(reason)),
            None => Body::Bytes(excerpt(bytes), None),
        }
    }
}

fn excerpt(bytes: &[u8]) -> Vec<u8> {
    bytes[..bytes.len().min(EXCERPT)].to_vec()
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Meta {
            sequence,
            len,
            lost,
            ..
        } = self.meta;
        write!(
            f,
            "#{sequence}  {len} bytes  {}  {} ago",
            self.content,
            units::span(self.age_s)
        )?;
        if lost > 0 {
            write!(f, "  {lost} lost before it")?;
        }
        match &self.body {
            Body::Decoded(fields) => write!(f, "\n{}", render::fields(fields, 1).trim_end()),
            Body::Bytes(bytes, reason) => {
                reason
                    .iter()
                    .try_for_each(|reason| write!(f, "\n  not decoded: {reason}"))?;
                write_dump(f, bytes)?;
                match len - bytes.len() {
                    0 => Ok(()),
                    more => write!(f, "\n  … {more} more bytes"),
                }
            }
        }
    }
}

fn write_dump(f: &mut fmt::Formatter<'_>, bytes: &[u8]) -> fmt::Result {
    for (row, chunk) in bytes.chunks(BYTES_PER_ROW).enumerate() {
        let columns: Vec<String> = chunk.iter().map(|byte| format!("{byte:02x}")).collect();
        let text: String = chunk.iter().map(|&byte| printable(byte)).collect();
        write!(
            f,
            "\n  {:06x}  {:<47}  {text}",
            row * BYTES_PER_ROW,
            columns.join(" ")
        )?;
    }
    Ok(())
}

fn printable(byte: u8) -> char {
    if byte.is_ascii_graphic() || byte == b' ' {
        char::from(byte)
    } else {
        '.'
    }
}

impl Record for Message {
    fn json(&self) -> Value {
        let mut line = json!({
            "event": "message",
            "topic": self.topic,
            "sequence": self.meta.sequence,
            "timestamp_ns": self.meta.timestamp_ns,
            "lost": self.meta.lost,
            "bytes": self.meta.len,
            "content": self.content,
        });
        match &self.body {
            Body::Decoded(fields) => line["message"] = fields.clone(),
            Body::Bytes(bytes, reason) => {
                line["hex"] = hex(bytes).into();
                if let Some(reason) = reason {
                    line["not_decoded"] = reason.clone().into();
                }
            }
        }
        line
    }
}
