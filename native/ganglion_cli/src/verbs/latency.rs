//! `ganglion latency`: how long a message takes to a reader.

use super::Verb;
use crate::gauge::{self, Gauge, Reading};
use crate::options::Options;
use crate::output::Output;
use crate::units::{self, rounded};
use crate::window::Window;
use conduit_ring::{Meta, ObserverOptions};
use program::{Failure, Log};
use serde_json::json;
use std::time::Duration;

pub const VERB: Verb = Verb {
    name: "latency",
    summary: "from publishing to here",
    help: HELP,
    takes_topic: true,
    options: gauge::OPTIONS,
    run,
};

const HELP: &str = "\
ganglion latency: how long it takes from a message's publishing to its being read here

Usage: ganglion latency TOPIC [options]

  --every SECONDS    from line to line, 0.01 to 3600; default 1
  --window SECONDS   how far back a line looks, 0.01 to 3600; default 5
  --count N          end after N lines
  --wait             wait for a topic that is not there
  --json             one JSON object a line
  --help             this text

Each line has the median, the 99th percentile and the greatest. What is measured begins with the publisher's time stamp,
taken before it copies the message into the ring, and ends when this program has a whole, validated copy: both copies and
a wake-up, not what came before (such as a camera's exposure).

This program takes no reader slot, so a publisher does not know that it sleeps. While some subscriber sleeps on the topic,
this program is woken with it and the figure is what such a subscriber has. Otherwise it looks every 0.1 ms by itself,
which adds up to that and the timer's own delay.
";

/// As short as a sleep can be that leaves the processor to others.
const NAP: Duration = Duration::from_micros(100);

fn run(options: &Options, output: &mut Output, log: Log) -> Result<(), Failure> {
    let watching = ObserverOptions {
        longest_nap: NAP,
        ..ObserverOptions::default()
    };
    gauge::run(Delays::new(options.window), options, &watching, output, log)
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

/// The least value that so many hundredths of all do not exceed.
fn percentile(sorted: &[u64], hundredths: usize) -> Option<u64> {
    let rank = (sorted.len() * hundredths).div_ceil(100);
    sorted.get(rank.saturating_sub(1)).copied()
}

impl Gauge for Delays {
    const EVENT: &'static str = "latency";

    fn message(&mut self, meta: &Meta, now_ns: u64) {
        self.messages += 1;
        self.lost += meta.lost;
        self.window
            .push(now_ns, now_ns.saturating_sub(meta.timestamp_ns));
    }

    fn reading(&mut self, now_ns: u64) -> Reading {
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
        Reading { text, fields }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_were_measured() {
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
        delays.message(&meta, 6_000);
        let fields = delays.reading(7_000).fields;
        assert_eq!(
            (&fields["p50_us"], &fields["max_us"]),
            (&json!(5.0), &json!(5.0))
        );
    }
}
