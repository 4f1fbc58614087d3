//! What the peers of the ring's benches share: options, pace, samples and the messages that they check.

use std::str::FromStr;
use std::time::Duration;

use conduit_ring::clock;

/// Bytes of the small message.
pub const SMALL: usize = 48;

/// `name value` pairs of the command line after the verb.
pub struct Arguments(Vec<String>);

impl Arguments {
    /// The verb and its arguments.
    pub fn of_process() -> (String, Arguments) {
        let mut all = std::env::args().skip(1);
        (all.next().unwrap_or_default(), Arguments(all.collect()))
    }

    /// The value of `--name`.
    ///
    /// # Panics
    /// When it is missing or does not parse: the benches are the only callers.
    pub fn get<T: FromStr>(&self, name: &str) -> T {
        let at = self.0.iter().position(|word| word == name);
        at.and_then(|at| self.0.get(at + 1)?.parse().ok())
            .unwrap_or_else(|| panic!("{name} VALUE is needed"))
    }
}

/// A small message that can be checked: the time at its front, then its number over and over.
pub fn stamped(number: u64) -> [u8; SMALL] {
    let mut message = [0; SMALL];
    for part in message.chunks_exact_mut(8) {
        part.copy_from_slice(&number.to_le_bytes());
    }
    message[..8].copy_from_slice(&clock::now_ns().to_le_bytes());
    message
}

/// How old the message is, in nanoseconds, by the clock now.
///
/// # Panics
/// When it is not message `number`, whole.
pub fn age_of(message: &[u8], number: u64) -> u64 {
    let now = clock::now_ns();
    assert_eq!(message.len(), SMALL, "length of message {number}");
    let word = |part: &[u8]| u64::from_le_bytes(part.try_into().expect("eight bytes"));
    assert!(
        message[8..]
            .chunks_exact(8)
            .all(|part| word(part) == number),
        "message {number} is not what was sent"
    );
    now.saturating_sub(word(&message[..8]))
}

/// Absolute deadlines at a rate.
pub struct Pace {
    next_ns: u64,
    period_ns: u64,
}

impl Pace {
    /// The first deadline is one period from now.
    pub fn new(rate_hz: u64) -> Self {
        let period_ns = 1_000_000_000 / rate_hz;
        Self {
            next_ns: clock::now_ns() + period_ns,
            period_ns,
        }
    }

    /// Sleeps until the next deadline.
    pub fn wait(&mut self) {
        std::thread::sleep(Duration::from_nanos(
            self.next_ns.saturating_sub(clock::now_ns()),
        ));
        self.next_ns += self.period_ns;
    }
}

/// Prints the median and the 99th percentile as one JSON object.
pub fn print_latencies(mut ages: Vec<u64>) {
    ages.sort_unstable();
    let at = |share: f64| ages[((ages.len() - 1) as f64 * share) as usize];
    println!("{{\"p50_ns\":{},\"p99_ns\":{}}}", at(0.5), at(0.99));
}

/// Prints the median of so many runs of `step`, in nanoseconds, as one JSON object. The first tenth warms up.
pub fn print_median(rounds: usize, calls: usize, mut step: impl FnMut()) {
    let mut samples: Vec<f64> = (0..rounds)
        .map(|_| {
            let start = clock::now_ns();
            (0..calls).for_each(|_| step());
            (clock::now_ns() - start) as f64 / calls as f64
        })
        .skip(rounds / 10)
        .collect();
    samples.sort_by(f64::total_cmp);
    println!("{{\"ns\":{:.1}}}", samples[samples.len() / 2]);
}
