//! Rate limit for the lines that the supervisor receives. Pure: the time is an argument.
//!
//! A program may print `rate` lines a second, and ten seconds' worth of them at once. Beyond
//! that, the limiter omits lines but keeps the last ones. It releases these, after the number of
//! omitted lines, when the rate allows a second's worth again or when the program ends. So a
//! flood of output has a bounded cost, and the last lines of a program that crashes are never
//! lost.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

const BURST_SECONDS: u32 = 10;
const KEPT_LINES: usize = 128;

/// What the supervisor receives.
#[derive(Debug, PartialEq)]
pub enum Item {
    Line(Vec<u8>),
    /// The number of lines omitted at this place.
    Omitted(u64),
}

pub struct Limiter {
    rate: f64,
    burst: f64,
    allowed: f64,
    counted_at: Instant,
    ready: VecDeque<Item>,
    held: VecDeque<Vec<u8>>,
    omitted: u64,
    limiting: bool,
}

impl Limiter {
    pub fn new(lines_per_second: u32, now: Instant) -> Limiter {
        let rate = f64::from(lines_per_second);
        let burst = rate * f64::from(BURST_SECONDS);
        Limiter {
            rate,
            burst,
            allowed: burst,
            counted_at: now,
            ready: VecDeque::new(),
            held: VecDeque::new(),
            omitted: 0,
            limiting: false,
        }
    }

    /// Accepts a line.
    pub fn push(&mut self, line: Vec<u8>, now: Instant) {
        self.recover(now);
        if !self.limiting && self.allowed >= 1.0 && self.has_room() {
            self.allowed -= 1.0;
            self.ready.push_back(Item::Line(line));
        } else {
            self.limiting = true;
            self.hold_back(line);
        }
    }

    fn hold_back(&mut self, line: Vec<u8>) {
        self.held.push_back(line);
        if self.held.len() > KEPT_LINES {
            self.held.pop_front();
            self.omitted += 1;
        }
    }

    /// Releases the held lines when the rate allows it and there is room for them.
    pub fn recover(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.counted_at).as_secs_f64();
        self.allowed = (self.allowed + passed * self.rate).min(self.burst);
        self.counted_at = now;
        if self.limiting && self.allowed >= self.rate && self.has_room() {
            self.allowed -= self.held.len() as f64;
            self.release();
        }
    }

    /// Releases all held lines, because the program has ended.
    pub fn finish(&mut self) {
        self.release();
    }

    fn release(&mut self) {
        self.limiting = false;
        if self.omitted > 0 {
            self.ready.push_back(Item::Omitted(self.omitted));
            self.omitted = 0;
        }
        self.ready.extend(self.held.drain(..).map(Item::Line));
    }

    // Bounds the items that wait for a supervisor that takes nothing.
    fn has_room(&self) -> bool {
        (self.ready.len() as f64) < self.burst
    }

    /// Returns when to call `recover`, or `None` while no lines are held or the supervisor has to
    /// take items first.
    pub fn due(&self) -> Option<Instant> {
        let missing = ((self.rate - self.allowed) / self.rate).max(0.0);
        (self.limiting && self.has_room())
            .then(|| self.counted_at + Duration::from_secs_f64(missing))
    }

    pub fn next(&mut self) -> Option<Item> {
        self.ready.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: u32 = 100;
    const BURST: usize = (RATE * BURST_SECONDS) as usize;

    fn line(number: usize) -> Vec<u8> {
        number.to_string().into_bytes()
    }

    fn taken(limiter: &mut Limiter) -> Vec<Item> {
        std::iter::from_fn(|| limiter.next()).collect()
    }

    fn lines(numbers: std::ops::Range<usize>) -> Vec<Item> {
        numbers.map(|number| Item::Line(line(number))).collect()
    }

    /// Counts the lines in `items` and the omitted lines that they report.
    fn accounted(items: &[Item]) -> u64 {
        items.iter().fold(0, |sum, item| match item {
            Item::Line(_) => sum + 1,
            Item::Omitted(count) => sum + count,
        })
    }

    #[test]
    fn lines_within_the_rate_pass_unchanged() {
        let mut now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        let mut received = Vec::new();
        for number in 0..5 * BURST {
            limiter.push(line(number), now);
            received.extend(taken(&mut limiter));
            now += Duration::from_millis(10);
        }
        assert!(received == lines(0..5 * BURST));
        assert_eq!(limiter.due(), None);
    }

    #[test]
    fn a_flood_yields_its_first_and_last_lines_and_the_number_between() {
        let now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        (0..300_000).for_each(|number| limiter.push(line(number), now));
        assert!(taken(&mut limiter) == lines(0..BURST));
        limiter.finish();
        let mut end = vec![Item::Omitted((300_000 - BURST - KEPT_LINES) as u64)];
        end.extend(lines(300_000 - KEPT_LINES..300_000));
        assert!(taken(&mut limiter) == end);
    }

    #[test]
    fn held_lines_are_released_when_due_and_later_lines_pass() {
        let now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        (0..10_000).for_each(|number| limiter.push(line(number), now));
        assert!(taken(&mut limiter) == lines(0..BURST));
        let due = limiter.due().unwrap() + Duration::from_millis(1);
        assert!(due > now);
        limiter.recover(now);
        assert_eq!(limiter.next(), None);
        limiter.recover(due);
        let received = taken(&mut limiter);
        assert_eq!(accounted(&received), (10_000 - BURST) as u64);
        assert!(matches!(received[0], Item::Omitted(_)));
        assert_eq!(limiter.due(), None);
        limiter.push(line(7), due + Duration::from_secs(1));
        assert_eq!(taken(&mut limiter), [Item::Line(line(7))]);
    }

    #[test]
    fn an_endless_flood_is_held_to_the_rate_and_every_line_is_accounted_for() {
        let mut now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        let mut received = Vec::new();
        for number in 0..600_000 {
            limiter.push(line(number), now);
            received.extend(taken(&mut limiter));
            now += Duration::from_micros(100);
        }
        let shown = received.iter().filter(|item| matches!(item, Item::Line(_)));
        let most = BURST + 60 * RATE as usize + KEPT_LINES;
        assert!(shown.count() <= most);
        assert!(received.len() <= most + 61);
        limiter.finish();
        received.extend(taken(&mut limiter));
        assert_eq!(accounted(&received), 600_000);
    }

    #[test]
    fn a_supervisor_that_takes_nothing_costs_bounded_memory_and_no_line_goes_uncounted() {
        let mut now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        for number in 0..100_000 {
            limiter.push(line(number), now);
            now += Duration::from_millis(20);
        }
        assert!(limiter.ready.len() + limiter.held.len() <= BURST + 2 * KEPT_LINES);
        assert_eq!(limiter.due(), None, "it would be due at once, for ever");
        limiter.finish();
        assert_eq!(accounted(&taken(&mut limiter)), 100_000);
    }
}
