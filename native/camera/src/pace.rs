//! When to take the next frame: absolute deadlines, so that no lateness adds up.

use std::time::{Duration, Instant};

/// Deadlines `start`, `start` + 1/rate, `start` + 2/rate and so on.
#[derive(Debug, Clone)]
pub struct Pace {
    start: Instant,
    rate_hz: f64,
    next: u64,
}

impl Pace {
    /// A pace whose first deadline is `start`.
    pub fn new(start: Instant, rate_hz: f64) -> Pace {
        Pace {
            start,
            rate_hz,
            next: 0,
        }
    }

    /// The next deadline. Those that `now` has already left a whole period behind are skipped: after a long pause
    /// frames come at the rate again, and not in a burst.
    pub fn next(&mut self, now: Instant) -> Instant {
        let elapsed = now.saturating_duration_since(self.start).as_secs_f64();
        let current = (elapsed * self.rate_hz) as u64;
        let number = self.next.max(current);
        self.next = number + 1;
        self.start + Duration::from_secs_f64(number as f64 / self.rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deadlines_are_multiples_of_the_period_however_late_each_call_is() {
        let start = Instant::now();
        let mut pace = Pace::new(start, 30.0);
        for n in 0..10_000u32 {
            let expected = start + Duration::from_secs_f64(f64::from(n) / 30.0);
            let deadline = pace.next(start + Duration::from_millis(33) * n);
            assert_eq!(deadline, expected);
        }
    }

    #[test]
    fn a_long_pause_is_not_made_up_for_in_a_burst() {
        let start = Instant::now();
        let mut pace = Pace::new(start, 10.0);
        pace.next(start);
        let late = pace.next(start + Duration::from_millis(1050));
        assert_eq!(late, start + Duration::from_secs(1));
        let following = pace.next(start + Duration::from_millis(1060));
        assert_eq!(following, start + Duration::from_millis(1100));
    }
}
