//! `ganglion hz`: measures the rate of a topic and the regularity of its messages.

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
    name: "hz",
    summary: "rate and regularity",
    help: HELP,
    takes_topic: true,
    options: gauge::OPTIONS,
    run,
};

const HELP: &str = "\
ganglion hz: measures the rate of a topic and the regularity of its messages

Usage: ganglion hz TOPIC [options]

  --every SECONDS    time between two lines, 0.01 to 3600; default 1
  --window SECONDS   time span that a line summarises, 0.01 to 3600; default 5
  --count N          end after N lines
  --wait             wait for a topic that does not exist
  --json             print one JSON object per line
  --help             print this help

Each line shows the rate, the mean, shortest and longest period between two messages and its
standard deviation, by the publisher's timestamps, and the numbers of received and lost
messages since the start. Lost messages were overwritten before ganglion read them; the rate
includes them, by their sequence numbers. A silence that is longer than the longest period
counts as a period that has not ended, so that the rate of a silent topic falls.

Without --wait a topic that does not exist is an error. ganglion continues when the publisher
dies or starts again, and prints a line about it; the time between is not a period. It takes no
reader slot.
";

fn run(options: &Options, output: &mut Output, log: Log) -> Result<(), Failure> {
    let gauge = Periods::new(options.window);
    gauge::run(gauge, options, &ObserverOptions::default(), output, log)
}

/// The step from one received message to the next.
struct Step {
    span_ns: u64,
    /// Difference of the sequence numbers: 1 unless messages were lost.
    steps: u64,
}

struct Periods {
    window: Window<Step>,
    /// The message with which the next period starts.
    previous: Option<Meta>,
    /// The newest timestamp, even if its publisher is gone.
    newest_ns: Option<u64>,
    messages: u64,
    lost: u64,
}

/// Statistics of the periods in a window, in seconds.
#[derive(Debug, PartialEq)]
struct Statistics {
    mean: f64,
    min: f64,
    max: f64,
    deviation: f64,
}

impl Periods {
    fn new(window: Duration) -> Periods {
        Periods {
            window: Window::new(window),
            previous: None,
            newest_ns: None,
            messages: 0,
            lost: 0,
        }
    }

    /// Returns the messages per second. Includes the silence since the last message if it is
    /// longer than any period.
    fn rate(&self, now_ns: u64) -> f64 {
        let steps: u64 = self.window.values().map(|step| step.steps).sum();
        let span: u64 = self.window.values().map(|step| step.span_ns).sum();
        let longest = self
            .window
            .values()
            .map(|step| step.span_ns)
            .max()
            .unwrap_or(0);
        let silence = self
            .newest_ns
            .map_or(0, |newest| now_ns.saturating_sub(newest));
        let ongoing = if silence > longest { silence } else { 0 };
        match span.saturating_add(ongoing) {
            0 => 0.0,
            span => steps as f64 / units::seconds(span),
        }
    }

    /// Returns the statistics, or `None` without a period. Periods with lost messages have
    /// unknown parts and count only in the mean.
    fn statistics(&self) -> Option<Statistics> {
        let steps: u64 = self.window.values().map(|step| step.steps).sum();
        let span: u64 = self.window.values().map(|step| step.span_ns).sum();
        let single = || self.window.values().filter(|step| step.steps == 1);
        let single = || single().map(|step| units::seconds(step.span_ns));
        let count = single().count() as f64;
        let mean_of_single = single().sum::<f64>() / count;
        let variance = single().map(|s| (s - mean_of_single).powi(2)).sum::<f64>() / count;
        (count > 0.0).then(|| Statistics {
            mean: units::seconds(span) / steps as f64,
            min: single().fold(f64::INFINITY, f64::min),
            max: single().fold(0.0, f64::max),
            deviation: variance.sqrt(),
        })
    }
}

impl Gauge for Periods {
    const EVENT: &'static str = "hz";

    fn record(&mut self, meta: &Meta, now_ns: u64) {
        self.messages += 1;
        self.lost += meta.lost;
        self.newest_ns = Some(meta.timestamp_ns);
        if let Some(previous) = self.previous.replace(*meta) {
            let step = Step {
                span_ns: meta.timestamp_ns.saturating_sub(previous.timestamp_ns),
                steps: meta.lost.saturating_add(1),
            };
            self.window.push(now_ns, step);
        }
    }

    fn interrupt(&mut self) {
        self.previous = None;
    }

    fn measurement(&mut self, now_ns: u64) -> Measurement {
        self.window.expire(now_ns);
        let rate = self.rate(now_ns);
        let statistics = self.statistics();
        let ms = |of: fn(&Statistics) -> f64| {
            let seconds = statistics.as_ref().map(of);
            seconds.map(|s| rounded(s * 1e3, 4))
        };
        let fields = json!({
            "rate_hz": rounded(rate, 4),
            "mean_ms": ms(|s| s.mean),
            "min_ms": ms(|s| s.min),
            "max_ms": ms(|s| s.max),
            "sd_ms": ms(|s| s.deviation),
            "messages": self.messages,
            "lost": self.lost,
        });
        let periods = match &statistics {
            None => "no period yet".into(),
            Some(s) => format!(
                "period mean {}  min {}  max {}  sd {}",
                units::span(s.mean),
                units::span(s.min),
                units::span(s.max),
                units::span(s.deviation)
            ),
        };
        let (messages, lost) = (self.messages, self.lost);
        let text = format!(
            "{}  {periods}  messages {messages}  lost {lost}",
            units::rate(rate)
        );
        Measurement { text, fields }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn meta(time_ms: u64, lost: u64) -> Meta {
        Meta {
            sequence: 0,
            timestamp_ns: time_ms * MS,
            len: 8,
            lost,
        }
    }

    fn periods(messages: &[(u64, u64)]) -> Periods {
        let mut periods = Periods::new(Duration::from_secs(5));
        for &(time_ms, lost) in messages {
            periods.record(&meta(time_ms, lost), time_ms * MS);
        }
        periods
    }

    #[test]
    fn regular_messages_have_a_rate_and_no_deviation() {
        let periods = periods(&[(0, 0), (10, 0), (20, 0), (30, 0)]);
        assert_eq!(periods.rate(31 * MS), 100.0);
        let statistics = periods.statistics().unwrap();
        assert_eq!(
            (statistics.mean, statistics.min, statistics.max),
            (0.01, 0.01, 0.01)
        );
        assert!(statistics.deviation < 1e-9);
    }

    #[test]
    fn lost_messages_count_in_rate_and_mean_and_not_as_long_periods() {
        let periods = periods(&[(0, 0), (10, 0), (40, 2), (50, 0)]);
        assert_eq!(periods.rate(51 * MS), 100.0);
        let statistics = periods.statistics().unwrap();
        assert_eq!((statistics.mean, statistics.max), (0.01, 0.01));
        assert_eq!((periods.messages, periods.lost), (4, 2));
    }

    #[test]
    fn the_rate_falls_in_silence_and_reaches_zero() {
        let mut periods = periods(&[(0, 0), (10, 0), (20, 0)]);
        assert_eq!(periods.rate(29 * MS), 100.0);
        assert_eq!(periods.rate(200 * MS), 10.0);
        assert_eq!(periods.measurement(60_000 * MS).fields["rate_hz"], 0.0);
        assert_eq!(
            periods.measurement(60_000 * MS).fields["mean_ms"],
            json!(null)
        );
    }

    #[test]
    fn the_time_without_a_publisher_is_not_a_period() {
        let mut periods = periods(&[(0, 0), (10, 0)]);
        periods.interrupt();
        assert_eq!(periods.rate(500 * MS), 2.0);
        for time in [1000, 1010] {
            periods.record(&meta(time, 0), time * MS);
        }
        assert_eq!(periods.statistics().unwrap().max, 0.01);
        assert_eq!(periods.rate(1011 * MS), 100.0);
    }

    #[test]
    fn the_deviation_is_that_of_the_periods() {
        let statistics = periods(&[(0, 0), (8, 0), (20, 0)]).statistics().unwrap();
        assert!((statistics.deviation - 0.002).abs() < 1e-9);
        assert_eq!((statistics.min, statistics.max), (0.008, 0.012));
    }
}
