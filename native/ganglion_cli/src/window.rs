//! A sliding window over a stream of values.

use std::collections::VecDeque;
use std::time::Duration;

/// The most values kept at any rate.
const MOST: usize = 1 << 20;

/// The values of the last time span.
#[derive(Debug)]
pub struct Window<T> {
    span_ns: u64,
    entries: VecDeque<(u64, T)>,
}

impl<T> Window<T> {
    /// Returns an empty window.
    pub fn new(span: Duration) -> Window<T> {
        Window {
            span_ns: u64::try_from(span.as_nanos()).unwrap_or(u64::MAX),
            entries: VecDeque::new(),
        }
    }

    /// Adds a value that arrived at `now_ns`.
    pub fn push(&mut self, now_ns: u64, value: T) {
        if self.entries.len() == MOST {
            self.entries.pop_front();
        }
        self.entries.push_back((now_ns, value));
    }

    /// Drops the values that are older than the span.
    pub fn expire(&mut self, now_ns: u64) {
        let oldest = now_ns.saturating_sub(self.span_ns);
        while self.entries.front().is_some_and(|&(at, _)| at < oldest) {
            self.entries.pop_front();
        }
    }

    /// Iterates over the values from the oldest.
    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.entries.iter().map(|(_, value)| value)
    }

    /// Returns the time span in nanoseconds.
    pub fn span_ns(&self) -> u64 {
        self.span_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_older_than_the_span_are_dropped() {
        let mut window = Window::new(Duration::from_nanos(10));
        for time in [1, 5, 20] {
            window.push(time, time);
        }
        window.expire(15);
        assert_eq!(window.values().copied().collect::<Vec<_>>(), [5, 20]);
        window.expire(100);
        assert_eq!(window.values().count(), 0);
    }
}
