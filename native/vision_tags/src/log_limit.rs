//! A rate limit for log lines that repeat with each frame.

use std::fmt;
use std::time::{Duration, Instant};

/// The shortest time between two lines.
const PAUSE: Duration = Duration::from_secs(10);

/// Counts repeated events of one kind and limits their log lines.
#[derive(Debug, Default)]
pub struct LogLimit {
    logged_at: Option<Instant>,
    suppressed: u64,
    total: u64,
}

impl LogLimit {
    /// Counts an event and returns the line to log: for the first event at once, then at most
    /// every ten seconds, with the number of suppressed lines.
    pub fn count(&mut self, now: Instant, event: impl fmt::Display) -> Option<String> {
        self.total += 1;
        if self.logged_at.is_some_and(|at| now < at + PAUSE) {
            self.suppressed += 1;
            return None;
        }
        self.logged_at = Some(now);
        Some(match std::mem::take(&mut self.suppressed) {
            0 => event.to_string(),
            suppressed => format!("{event} (and {suppressed} more)"),
        })
    }

    /// Returns the number of events.
    pub fn total(&self) -> u64 {
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_event_is_logged_at_once_and_the_next_after_ten_seconds() {
        let mut limit = LogLimit::default();
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        assert_eq!(limit.count(at(0), "dark").as_deref(), Some("dark"));
        assert_eq!(limit.count(at(1), "dark"), None);
        assert_eq!(limit.count(at(9), "dark"), None);
        let line = limit.count(at(10), "dark");
        assert_eq!(line.as_deref(), Some("dark (and 2 more)"));
        assert_eq!(limit.count(at(20), "dark").as_deref(), Some("dark"));
        assert_eq!(limit.total(), 5);
    }
}
