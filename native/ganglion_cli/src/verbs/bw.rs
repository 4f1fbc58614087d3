//! `ganglion bw`: measures the bandwidth of a topic.

use crate::gauge::{self, Gauge, Measurement};
use crate::options::Options;
use crate::output::Output;
use crate::units::{self, rounded};
use crate::verb::Verb;
use crate::window::Window;
use conduit_ring::{Meta, ObserverOptions, clock};
use program::{Failure, Log};
use serde_json::json;
use std::time::Duration;

pub const VERB: Verb = Verb {
    name: "bw",
    summary: "bytes per second and message sizes",
    help: HELP,
    takes_topic: true,
    options: gauge::OPTIONS,
    run,
};

const HELP: &str = "\
ganglion bw: measures the bandwidth of a topic

Usage: ganglion bw TOPIC [options]

  --every SECONDS    time between two lines, 0.01 to 3600; default 1
  --window SECONDS   time span that a line summarises, 0.01 to 3600; default 5
  --count N          end after N lines
  --wait             wait for a topic that does not exist
  --json             print one JSON object per line
  --help             print this help

Each line shows bytes and messages per second, the mean, smallest and largest message size, and
the numbers of received and lost messages since the start. Bytes are those of the messages
without the ring's headers. Lost messages, which were overwritten before ganglion read them, do
not count because their sizes are unknown.

Without --wait a topic that does not exist is an error. ganglion continues when the publisher
dies or starts again, and prints a line about it. It takes no reader slot.
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

    fn record(&mut self, meta: &Meta, now_ns: u64) {
        self.messages += 1;
        self.lost += meta.lost;
        self.window.push(now_ns, meta.len);
    }

    fn measurement(&mut self, now_ns: u64) -> Measurement {
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
        Measurement { text, fields }
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
    fn rates_are_those_of_the_window_and_of_a_shorter_time_at_the_start() {
        let mut sizes = Sizes::new(Duration::from_secs(5), 100 * S);
        sizes.record(&message(100), 101 * S);
        sizes.record(&message(300), 102 * S);
        let fields = sizes.measurement(102 * S).fields;
        assert_eq!(fields["bytes_per_s"], 200.0);
        assert_eq!(fields["messages_per_s"], 1.0);
        assert_eq!(fields["mean_bytes"], 200.0);
        assert_eq!(
            (&fields["min_bytes"], &fields["max_bytes"]),
            (&json!(100), &json!(300))
        );

        let fields = sizes.measurement(107 * S).fields;
        assert_eq!(fields["bytes_per_s"], 60.0);
        let fields = sizes.measurement(120 * S).fields;
        assert_eq!(
            (&fields["bytes_per_s"], &fields["messages"]),
            (&json!(0.0), &json!(2))
        );
    }
}
