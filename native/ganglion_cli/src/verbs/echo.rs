//! `ganglion echo`: the messages themselves.

use super::Verb;
use crate::decode::{decode, hex};
use crate::options::Options;
use crate::output::{Output, Record};
use crate::watch::{self, Next, Sight, Watch};
use crate::{content, render, units};
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
ganglion echo: prints a topic's messages

Usage: ganglion echo TOPIC [options]

  --count N   end after N messages
  --latest    begin with the newest message that is there, not with the next one
  --raw       decode nothing: every byte, hexadecimal
  --wait      wait for a topic that is not there
  --json      one JSON object a line
  --help      this text

Decodes what the topic's content tag names: conduit/frame (the header, not the pixels), sensor_msgs/msg/Imu and
apriltag_msgs/msg/AprilTagDetectionArray. Of anything else, and of what is not what its tag says, the first 256 bytes are
printed, hexadecimal.

A topic that is not there is a mistake, unless you --wait for it. It goes on when the publisher
dies and when it comes back, which it says. It takes no reader slot.
";

/// Bytes of an undecoded message that are printed unless all are asked for.
const EXCERPT: usize = 256;
const BYTES_A_ROW: usize = 16;

fn run(options: &Options, output: &mut Output, log: Log) -> Result<(), Failure> {
    let start = if options.latest {
        Start::Latest
    } else {
        Start::New
    };
    let watching = ObserverOptions {
        start,
        ..ObserverOptions::default()
    };
    let mut watch = Watch::open(options, &watching, log)?;
    let mut left = options.count;
    watch::until_enough(&mut watch, output, |watch, sight, output| {
        if let Sight::Message(meta) = sight {
            output.put(&Message::read(watch, meta, options))?;
            left = left.map(|left| left - 1);
        }
        Ok(match left {
            Some(0) => Next::Enough,
            _ => Next::By(Instant::now() + Duration::from_secs(1)),
        })
    })
}

/// A message as it is printed.
struct Message {
    topic: String,
    content: String,
    meta: Meta,
    age_s: f64,
    body: Body,
}

enum Body {
    Decoded(Value),
    /// Its bytes, or the first of them; and why they were not decoded, if they should have been.
    Bytes(Vec<u8>, Option<String>),
}

impl Message {
    fn read(watch: &Watch, meta: Meta, options: &Options) -> Message {
        Message {
            topic: options.topic().name().to_owned(),
            content: content::name(watch.content()),
            meta,
            age_s: units::age_s(clock::now_ns(), meta.timestamp_ns),
            body: Body::read(watch, options.raw),
        }
    }
}

impl Body {
    fn read(watch: &Watch, raw: bool) -> Body {
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
            write!(f, "  {lost} lost before")?;
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
    for (row, chunk) in bytes.chunks(BYTES_A_ROW).enumerate() {
        let columns: Vec<String> = chunk.iter().map(|byte| format!("{byte:02x}")).collect();
        let text: String = chunk.iter().map(|&byte| printable(byte)).collect();
        write!(
            f,
            "\n  {:06x}  {:<47}  {text}",
            row * BYTES_A_ROW,
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
