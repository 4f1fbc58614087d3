//! `ganglion latency`: measures the time from publishing a message to reading it.

use crate::gauge::{self, Gauge, Measurement};
use crate::options::Options;
use crate::output::Output;
use crate::units::{self, rounded};
use crate::verb::Verb;
use crate::window::Window;
use conduit_ring::{Meta, ObserverOptions};
use program::{Failure, Log};
use serde_json::json;
use std::time::Duration;

pub const VERB: Verb = Verb {
    name: "latency",
    summary: "time from publishing to reading",
    help: HELP,
    takes_topic: true,
    options: gauge::OPTIONS,
    run,
};

const HELP: &str = "\
ganglion latency: measures the time from publishing a message to reading it

Usage: ganglion latency TOPIC [options]

  --every SECONDS    time between two lines, 0.01 to 3600; default 1
  --window SECONDS   time span that a line summarises, 0.01 to 3600; default 5
  --count N          end after N lines
  --wait             wait for a topic that does not exist
  --json             print one JSON object per line
  --help             print this help

Each line shows the median, the 99th percentile and the maximum. The measured time starts with
the publisher's timestamp, taken before the publisher copies the message into the ring, and
ends when ganglion has a complete, validated copy. It includes both copies and a wake-up, but
nothing before, such as a camera's exposure.

ganglion takes no reader slot, so a publisher does not know that it waits. While a subscriber
waits on the topic, ganglion is woken with it, and the result is the latency of such a
subscriber. Otherwise ganglion polls every 0.1 ms, which adds up to that time and the timer's
own delay.
";

/// The polling period: as short as a sleep can be that leaves the processor to others.
const NAP: Duration = Duration::from_micros(100);

fn run(options: &Options, output: &mut Output, log: Log) -> Result<(), Failure> {
    let observing = ObserverOptions {
        longest_nap: NAP,
        ..ObserverOptions::default()
    };
    gauge::run(
        Delays::new(options.window),
        options,
        &observing,
        output,
        log,
    )
}

struct Delays {
    window: Window<u64>,
    messages: u64,
    lost: u64,
}

impl Delays {
    fn new(window: Duration) -> Delays {
        Delays {
            window: Window::new(window),
            messages: 0,
            lost: 0,
        }
    }
}

/// Returns the smallest value that the given percentage of all values does not exceed.
fn percentile(sorted: &[u64], hundredths: usize) -> Option<u64> {
    let rank = (sorted.len() * hundredths).div_ceil(100);
    sorted.get(rank.saturating_sub(1)).copied()
}

impl Gauge for Delays {
    const EVENT: &'static str = "latency";

    fn record(&mut self, meta: &Meta, now_ns: u64) {
        self.messages += 1;
        self.lost += meta.lost;
        self.window
            .push(now_ns, now_ns.saturating_sub(meta.timestamp_ns));
    }

    fn measurement(&mut self, now_ns: u64) -> Measurement {
        self.window.expire(now_ns);
        let mut sorted: Vec<u64> = self.window.values().copied().collect();
        sorted.sort_unstable();
        let [p50, p99, max] = [50, 99, 100].map(|hundredths| percentile(&sorted, hundredths));
        let us = |ns: Option<u64>| ns.map(|ns| rounded(ns as f64 / 1e3, 3));
        let fields = json!({
            "p50_us": us(p50),
            "p99_us": us(p99),
            "max_us": us(max),
            "window_messages": sorted.len(),
            "messages": self.messages,
            "lost": self.lost,
            "nap_us": NAP.as_micros() as u64,
        });
        let delays = match (p50, p99, max) {
            (Some(p50), Some(p99), Some(max)) => {
                let [p50, p99, max] = [p50, p99, max].map(|ns| units::span(units::seconds(ns)));
                format!("p50 {p50}  p99 {p99}  max {max}")
            }
            _ => "no message".into(),
        };
        let text = format!(
            "{delays}  of {}  messages {}  lost {}",
            sorted.len(),
            self.messages,
            self.lost
        );
        Measurement { text, fields }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_measured_values() {
        let hundred: Vec<u64> = (1..=100).collect();
        assert_eq!(
            [50, 99, 100].map(|p| percentile(&hundred, p)),
            [50, 99, 100].map(Some)
        );
        assert_eq!([50, 99, 100].map(|p| percentile(&[7], p)), [Some(7); 3]);
        assert_eq!(percentile(&[], 50), None);
    }

    #[test]
    fn a_delay_is_from_the_time_stamp_to_now() {
        let mut delays = Delays::new(Duration::from_secs(5));
        let meta = Meta {
            sequence: 0,
            timestamp_ns: 1_000,
            len: 1,
            lost: 0,
        };
        delays.record(&meta, 6_000);
        let fields = delays.measurement(7_000).fields;
        assert_eq!(
            (&fields["p50_us"], &fields["max_us"]),
            (&json!(5.0), &json!(5.0))
        );
    }
}
