//! `ganglion info`: shows the details of a topic.

use crate::options::Options;
use crate::output::{Output, Record, or_dash};
use crate::verb::Verb;
use crate::{failure, missing_topic, names, process, units};
use conduit_ring::{Error, Info, Reader, State, clock};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;

pub const VERB: Verb = Verb {
    name: "info",
    summary: "details of a topic",
    help: HELP,
    takes_topic: true,
    options: &["--json", "--help"],
    run,
};

const HELP: &str = "\
ganglion info: shows the details of a topic

Usage: ganglion info TOPIC [options]

  --json   print one JSON object
  --help   print this help

The state is live, dead (the publisher died; the next one takes over), closed, retired (replaced
by a topic of another geometry) or legacy (from a publisher without a lock, so that its life
cannot be checked). Publisher and readers are alive if they hold their locks, which the kernel
releases when they die. Process ids are those that the processes wrote. A dead reader has leaked
its slot; the next subscriber reclaims it, and so does `ganglion doctor --fix`.
";

fn run(options: &Options, output: &mut Output, _log: Log) -> Result<(), Failure> {
    let info = Info::read(options.topic()).map_err(|error| match error {
        Error::NoTopic { .. } => missing_topic::failure(options.topic()),
        error => failure::runtime(error),
    })?;
    output.put(&Details {
        now_ns: clock::now_ns(),
        info,
    })
}

struct Details {
    now_ns: u64,
    info: Info,
}

impl Details {
    fn age_s(&self) -> Option<f64> {
        let last = self.info.last_publish_ns;
        (last > 0).then(|| units::age_s(self.now_ns, last))
    }

    fn publisher(&self) -> String {
        match self.info.state {
            State::Legacy => "unknown".into(),
            State::Live => process::label(self.info.writer_pid),
            _ => format!("was pid {}", self.info.writer_pid),
        }
    }
}

impl fmt::Display for Details {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let info = &self.info;
        let geometry = info.geometry;
        writeln!(f, "topic       {}", info.topic.name())?;
        writeln!(f, "file        {}", info.topic.path().display())?;
        writeln!(f, "state       {}", names::state(info.state))?;
        writeln!(
            f,
            "publisher   {}, after {} takeovers",
            self.publisher(),
            info.epoch
        )?;
        writeln!(f, "content     {}", names::encoding(info.content))?;
        writeln!(
            f,
            "slots       {} of {} bytes for messages of up to {} bytes, {} in total",
            geometry.slot_count(),
            geometry.slot_size(),
            geometry.max_message_size(),
            units::bytes(geometry.segment_len() as f64)
        )?;
        writeln!(f, "published   {}", info.published)?;
        let age = self.age_s().map(|age| format!("{} ago", units::span(age)));
        writeln!(f, "last        {}", or_dash(age))?;
        writeln!(
            f,
            "dropped     {} because readers held slots, {} because of their size",
            info.dropped_pinned, info.rejected_oversize
        )?;
        writeln!(f, "wake-ups    {}", info.wake_count)?;
        writeln!(f, "instance    {:016x}", info.instance_id)?;
        write!(f, "readers     {} of 16", info.readers.len())?;
        info.readers
            .iter()
            .try_for_each(|reader| write_reader(f, reader, info.published))
    }
}

fn write_reader(f: &mut fmt::Formatter<'_>, reader: &Reader, published: u64) -> fmt::Result {
    if !reader.native {
        return write!(f, "\n  #{:<2}  legacy, state unknown", reader.index);
    }
    let life = match (reader.alive, reader.waiting) {
        (false, _) => "dead, slot leaked",
        (true, true) => "waiting",
        (true, false) => "running",
    };
    write!(
        f,
        "\n  #{:<2}  {}  {life}  {} behind  {} lost",
        reader.index,
        process::label(reader.pid),
        published.saturating_sub(reader.next_sequence),
        reader.lost
    )?;
    match reader.held.as_slice() {
        [] => Ok(()),
        held => write!(f, "  holds {}", numbers(held)),
    }
}

fn numbers(numbers: &[u64]) -> String {
    let numbers: Vec<String> = numbers.iter().map(u64::to_string).collect();
    numbers.join(", ")
}

impl Record for Details {
    fn json(&self) -> Value {
        let info = &self.info;
        let readers: Vec<Value> = info.readers.iter().map(reader_json).collect();
        let native = info.state != State::Legacy;
        json!({
            "topic": info.topic.name(),
            "file": info.topic.path().to_string_lossy(),
            "state": names::state(info.state),
            "pid": native.then_some(info.writer_pid),
            "epoch": info.epoch,
            "instance_id": format!("{:016x}", info.instance_id),
            "content": names::encoding(info.content),
            "content_tag": format!("{:016x}", info.content.value()),
            "slot_count": info.geometry.slot_count(),
            "slot_size": info.geometry.slot_size(),
            "max_message_size": info.geometry.max_message_size(),
            "file_bytes": info.geometry.segment_len(),
            "published": info.published,
            "age_s": self.age_s().map(|age| units::rounded(age, 6)),
            "dropped_pinned": info.dropped_pinned,
            "rejected_oversize": info.rejected_oversize,
            "wake_count": info.wake_count,
            "readers": readers,
        })
    }
}

fn reader_json(reader: &Reader) -> Value {
    if !reader.native {
        let next = reader.next_sequence;
        return json!({"slot": reader.index, "native": false, "next_sequence": next});
    }
    json!({
        "slot": reader.index,
        "native": true,
        "alive": reader.alive,
        "waiting": reader.waiting,
        "pid": reader.pid,
        "next_sequence": reader.next_sequence,
        "lost": reader.lost,
        "held": reader.held,
    })
}
