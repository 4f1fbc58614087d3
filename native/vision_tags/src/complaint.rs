//! Complaints that come with each frame are said once in a while.

use std::fmt;
use std::time::{Duration, Instant};

/// The shortest time between two lines of one kind.
const PAUSE: Duration = Duration::from_secs(10);

/// Complaints of one kind.
#[derive(Debug, Default)]
pub struct Complaints {
    said: Option<Instant>,
    unsaid: u64,
    total: u64,
}

impl Complaints {
    /// Counts one, and gives the line to say: the first at once, then one in ten seconds, with the number of those that
    /// were kept quiet.
    pub fn add(&mut self, now: Instant, what: impl fmt::Display) -> Option<String> {
        self.total += 1;
        if self.said.is_some_and(|said| now < said + PAUSE) {
            self.unsaid += 1;
            return None;
        }
        self.said = Some(now);
        let unsaid = std::mem::take(&mut self.unsaid);
        Some(match unsaid {
            0 => what.to_string(),
            _ => format!("{what} (and {unsaid} more like it)"),
        })
    }

    /// How many there were.
    pub fn total(&self) -> u64 {
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_is_said_at_once_and_the_next_after_ten_seconds_with_their_number() {
        let mut complaints = Complaints::default();
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        assert_eq!(complaints.add(at(0), "dark").as_deref(), Some("dark"));
        assert_eq!(complaints.add(at(1), "dark"), None);
        assert_eq!(complaints.add(at(9), "dark"), None);
        let line = complaints.add(at(10), "dark");
        assert_eq!(line.as_deref(), Some("dark (and 2 more like it)"));
        assert_eq!(complaints.add(at(20), "dark").as_deref(), Some("dark"));
        assert_eq!(complaints.total(), 5);
    }
}
