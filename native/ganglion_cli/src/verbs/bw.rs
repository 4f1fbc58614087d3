//! `ganglion bw`: how many bytes go through a topic.

use super::Verb;
use crate::gauge::{self, Gauge, Reading};
use crate::options::Options;
use crate::output::Output;
use crate::units::{self, rounded};
use crate::window::Window;
use conduit_ring::{Meta, ObserverOptions, clock};
use program::{Failure, Log};
use serde_json::json;
use std::time::Duration;

pub const VERB: Verb = Verb {
    name: "bw",
    summary: "bytes a second, and sizes",
    help: HELP,
    takes_topic: true,
    options: gauge::OPTIONS,
    run,
};

const HELP: &str = "\
ganglion bw: how many bytes go through a topic

Usage: ganglion bw TOPIC [options]

  --every SECONDS    from line to line, 0.01 to 3600; default 1
  --window SECONDS   how far back a line looks, 0.01 to 3600; default 5
  --count N          end after N lines
  --wait             wait for a topic that is not there
  --json             one JSON object a line
  --help             this text

Each line has bytes and messages a second, the mean, least and greatest size of a message, and how many messages were
seen and lost since the start. Bytes are those of the messages, without the ring's own; those of lost messages, which
were overwritten before they were seen here, are not known and do not count.

A topic that is not there is a mistake, unless you --wait for it. It goes on when the publisher
dies and when it comes back, which it says. It takes no reader slot.
";

fn run(options: &Options, output: &mut Output, log: Log) -> Result<(), Failure> {
    let gauge = Sizes::new(options.window, clock::now_ns());
    gauge::run(gauge, options, &ObserverOptions::default(), output, log)
}

struct Sizes {
    window: Window<usize>,
    start_ns: u64,
    messages: u64,
    lost: u64,
}

impl Sizes {
    fn new(window: Duration, start_ns: u64) -> Sizes {
        Sizes {
            window: Window::new(window),
            start_ns,
            messages: 0,
            lost: 0,
        }
    }
}

impl Gauge for Sizes {
    const EVENT: &'static str = "bw";

    fn message(&mut self, meta: &Meta, now_ns: u64) {
        self.messages += 1;
        self.lost += meta.lost;
        self.window.push(now_ns, meta.len);
    }

    fn reading(&mut self, now_ns: u64) -> Reading {
        self.window.expire(now_ns);
        let elapsed_ns = now_ns
            .saturating_sub(self.start_ns)
            .min(self.window.span_ns());
        let elapsed_s = units::seconds(elapsed_ns.max(1));
        let count = self.window.values().count() as f64;
        let bytes = self.window.values().sum::<usize>() as f64;
        let least = self.window.values().min().copied();
        let greatest = self.window.values().max().copied();
        let mean = (count > 0.0).then(|| bytes / count);
        let fields = json!({
            "bytes_per_s": rounded(bytes / elapsed_s, 1),
            "messages_per_s": rounded(count / elapsed_s, 4),
            "mean_bytes": mean.map(|mean| rounded(mean, 1)),
            "min_bytes": least,
            "max_bytes": greatest,
            "messages": self.messages,
            "lost": self.lost,
        });
        let sizes = match (mean, least, greatest) {
            (Some(mean), Some(least), Some(greatest)) => {
                format!("size mean {mean:.0}  min {least}  max {greatest} B")
            }
            _ => "no message".into(),
        };
        let text = format!(
            "{}/s  {}  {sizes}  messages {}  lost {}",
            units::bytes(bytes / elapsed_s),
            units::rate(count / elapsed_s),
            self.messages,
            self.lost
        );
        Reading { text, fields }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn message(len: usize) -> Meta {
        Meta {
            sequence: 0,
            timestamp_ns: 0,
            len,
            lost: 0,
        }
    }

    #[test]
    fn bytes_a_second_are_those_of_the_window_and_of_less_in_the_beginning() {
        let mut sizes = Sizes::new(Duration::from_secs(5), 100 * S);
        sizes.message(&message(100), 101 * S);
        sizes.message(&message(300), 102 * S);
        let fields = sizes.reading(102 * S).fields;
        assert_eq!(fields["bytes_per_s"], 200.0);
        assert_eq!(fields["messages_per_s"], 1.0);
        assert_eq!(fields["mean_bytes"], 200.0);
        assert_eq!(
            (&fields["min_bytes"], &fields["max_bytes"]),
            (&json!(100), &json!(300))
        );

        let fields = sizes.reading(107 * S).fields;
        assert_eq!(fields["bytes_per_s"], 60.0);
        let fields = sizes.reading(120 * S).fields;
        assert_eq!(
            (&fields["bytes_per_s"], &fields["messages"]),
            (&json!(0.0), &json!(2))
        );
    }
}
