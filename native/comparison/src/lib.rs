//! The shared parts of the benchmark peers: arguments, deadlines, messages and statistics.

use std::str::FromStr;
use std::time::Duration;

use conduit_ring::clock;

/// Size of the small message in bytes.
pub const SMALL: usize = 48;

/// The `--name value` pairs of the command line.
pub struct Arguments(Vec<String>);

impl Arguments {
    /// Returns the verb and its arguments.
    pub fn of_process() -> (String, Arguments) {
        let mut all = std::env::args().skip(1);
        (all.next().unwrap_or_default(), Arguments(all.collect()))
    }

    /// Returns the value of `--name`.
    ///
    /// # Panics
    ///
    /// If the value is missing or invalid.
    pub fn get<T: FromStr>(&self, name: &str) -> T {
        let at = self.0.iter().position(|word| word == name);
        at.and_then(|at| self.0.get(at + 1)?.parse().ok())
            .unwrap_or_else(|| panic!("{name} VALUE is missing or invalid"))
    }
}

/// Returns a small message: the time, then the message's number repeated.
pub fn stamped(number: u64) -> [u8; SMALL] {
    let mut message = [0; SMALL];
    for part in message.chunks_exact_mut(8) {
        part.copy_from_slice(&number.to_le_bytes());
    }
    message[..8].copy_from_slice(&clock::now_ns().to_le_bytes());
    message
}

/// Returns the age of a message in nanoseconds.
///
/// # Panics
///
/// If the message is not message `number` or is damaged.
pub fn age_of(message: &[u8], number: u64) -> u64 {
    let now = clock::now_ns();
    assert_eq!(message.len(), SMALL, "length of message {number}");
    let word = |part: &[u8]| u64::from_le_bytes(part.try_into().expect("eight bytes"));
    assert!(
        message[8..]
            .chunks_exact(8)
            .all(|part| word(part) == number),
        "message {number} is damaged"
    );
    now.saturating_sub(word(&message[..8]))
}

/// Periodic deadlines.
pub struct Deadlines {
    next_ns: u64,
    period_ns: u64,
}

impl Deadlines {
    /// Returns deadlines at a rate. The first one is one period from now.
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

/// Prints the median and the 99th percentile in nanoseconds as one JSON object.
pub fn print_latencies(mut ages: Vec<u64>) {
    ages.sort_unstable();
    let at = |share: f64| ages[((ages.len() - 1) as f64 * share) as usize];
    println!("{{\"p50_ns\":{},\"p99_ns\":{}}}", at(0.5), at(0.99));
}

/// Runs `step` in `rounds` rounds of `calls` calls. Prints the median duration of a call in
/// nanoseconds as one JSON object. Ignores the first tenth of the rounds.
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
