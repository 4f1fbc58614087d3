//! The times at which frames are due. Deadlines are absolute, so that delays do not add up.

use std::time::{Duration, Instant};

/// The deadlines `start`, `start` + 1/rate, `start` + 2/rate and so on.
#[derive(Debug, Clone)]
pub struct Deadlines {
    start: Instant,
    rate_hz: f64,
    next: u64,
}

impl Deadlines {
    /// Returns deadlines of which the first is `start`.
    pub fn new(start: Instant, rate_hz: f64) -> Deadlines {
        Deadlines {
            start,
            rate_hz,
            next: 0,
        }
    }

    /// Returns the next deadline. Skips deadlines that are a whole period or more before `now`,
    /// so that frames resume at the rate after a long pause instead of in a burst.
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
    fn deadlines_are_multiples_of_the_period_however_late_the_calls_are() {
        let start = Instant::now();
        let mut deadlines = Deadlines::new(start, 30.0);
        for n in 0..10_000u32 {
            let expected = start + Duration::from_secs_f64(f64::from(n) / 30.0);
            let deadline = deadlines.next(start + Duration::from_millis(33) * n);
            assert_eq!(deadline, expected);
        }
    }

    #[test]
    fn no_burst_follows_a_long_pause() {
        let start = Instant::now();
        let mut deadlines = Deadlines::new(start, 10.0);
        deadlines.next(start);
        let late = deadlines.next(start + Duration::from_millis(1050));
        assert_eq!(late, start + Duration::from_secs(1));
        let following = deadlines.next(start + Duration::from_millis(1060));
        assert_eq!(following, start + Duration::from_millis(1100));
    }
}
