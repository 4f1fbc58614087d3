//! How many lines go on to the supervisor. Pure: the time is an argument.
//!
//! A program may print `rate` lines a second, and ten seconds' worth of them at once. What goes
//! beyond is left out but for the last lines, which wait: they follow, after the number of those
//! left out, when a second's worth may go again, or when the program ends. So a storm costs
//! nobody anything, and the last words of a program that dies are never among what is lost.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

const BURST_SECONDS: u32 = 10;
const LAST_LINES: usize = 128;

/// What goes on to the supervisor.
#[derive(Debug, PartialEq)]
pub enum Item {
    Line(Vec<u8>),
    /// So many lines are left out at this place.
    LeftOut(u64),
}

pub struct Limiter {
    rate: f64,
    burst: f64,
    allowed: f64,
    counted_at: Instant,
    ready: VecDeque<Item>,
    last: VecDeque<Vec<u8>>,
    left_out: u64,
    storm: bool,
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
            last: VecDeque::new(),
            left_out: 0,
            storm: false,
        }
    }

    /// Takes a line.
    pub fn push(&mut self, line: Vec<u8>, now: Instant) {
        self.recover(now);
        if !self.storm && self.allowed >= 1.0 && self.has_room() {
            self.allowed -= 1.0;
            self.ready.push_back(Item::Line(line));
        } else {
            self.storm = true;
            self.keep(line);
        }
    }

    fn keep(&mut self, line: Vec<u8>) {
        self.last.push_back(line);
        if self.last.len() > LAST_LINES {
            self.last.pop_front();
            self.left_out += 1;
        }
    }

    /// Ends a storm when it is over, or when there is room for an excerpt of it.
    pub fn recover(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.counted_at).as_secs_f64();
        self.allowed = (self.allowed + passed * self.rate).min(self.burst);
        self.counted_at = now;
        if self.storm && self.allowed >= self.rate && self.has_room() {
            self.allowed -= self.last.len() as f64;
            self.release();
        }
    }

    /// The program has ended: all that waits may go.
    pub fn finish(&mut self) {
        self.release();
    }

    fn release(&mut self) {
        self.storm = false;
        if self.left_out > 0 {
            self.ready.push_back(Item::LeftOut(self.left_out));
            self.left_out = 0;
        }
        self.ready.extend(self.last.drain(..).map(Item::Line));
    }

    // What a supervisor that takes nothing lets pile up is bounded too.
    fn has_room(&self) -> bool {
        (self.ready.len() as f64) < self.burst
    }

    /// When `recover` is due, if it is and time is what it waits for.
    pub fn due(&self) -> Option<Instant> {
        let missing = ((self.rate - self.allowed) / self.rate).max(0.0);
        (self.storm && self.has_room()).then(|| self.counted_at + Duration::from_secs_f64(missing))
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

    /// The number of the lines in `items`, and of those that they say are left out.
    fn accounted(items: &[Item]) -> u64 {
        items.iter().fold(0, |sum, item| match item {
            Item::Line(_) => sum + 1,
            Item::LeftOut(count) => sum + count,
        })
    }

    #[test]
    fn what_stays_within_the_rate_goes_on_unchanged() {
        let mut now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        let mut told = Vec::new();
        for number in 0..5 * BURST {
            limiter.push(line(number), now);
            told.extend(taken(&mut limiter));
            now += Duration::from_millis(10);
        }
        assert!(told == lines(0..5 * BURST));
        assert_eq!(limiter.due(), None);
    }

    #[test]
    fn of_a_storm_the_beginning_the_end_and_the_number_between_are_told() {
        let now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        (0..300_000).for_each(|number| limiter.push(line(number), now));
        assert!(taken(&mut limiter) == lines(0..BURST));
        limiter.finish();
        let mut end = vec![Item::LeftOut((300_000 - BURST - LAST_LINES) as u64)];
        end.extend(lines(300_000 - LAST_LINES..300_000));
        assert!(taken(&mut limiter) == end);
    }

    #[test]
    fn the_end_of_a_storm_is_told_when_it_is_due_and_what_follows_goes_on() {
        let now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        (0..10_000).for_each(|number| limiter.push(line(number), now));
        assert!(taken(&mut limiter) == lines(0..BURST));
        let due = limiter.due().unwrap() + Duration::from_millis(1);
        assert!(due > now);
        limiter.recover(now);
        assert_eq!(limiter.next(), None);
        limiter.recover(due);
        let told = taken(&mut limiter);
        assert_eq!(accounted(&told), (10_000 - BURST) as u64);
        assert!(matches!(told[0], Item::LeftOut(_)));
        assert_eq!(limiter.due(), None);
        limiter.push(line(7), due + Duration::from_secs(1));
        assert_eq!(taken(&mut limiter), [Item::Line(line(7))]);
    }

    #[test]
    fn a_storm_that_does_not_end_is_held_to_the_rate_and_every_line_is_accounted_for() {
        let mut now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        let mut told = Vec::new();
        for number in 0..600_000 {
            limiter.push(line(number), now);
            told.extend(taken(&mut limiter));
            now += Duration::from_micros(100);
        }
        let shown = told.iter().filter(|item| matches!(item, Item::Line(_)));
        let most = BURST + 60 * RATE as usize + LAST_LINES;
        assert!(shown.count() <= most);
        assert!(told.len() <= most + 61);
        limiter.finish();
        told.extend(taken(&mut limiter));
        assert_eq!(accounted(&told), 600_000);
    }

    #[test]
    fn a_supervisor_that_takes_nothing_costs_a_bounded_room_and_loses_no_count() {
        let mut now = Instant::now();
        let mut limiter = Limiter::new(RATE, now);
        for number in 0..100_000 {
            limiter.push(line(number), now);
            now += Duration::from_millis(20);
        }
        assert!(limiter.ready.len() + limiter.last.len() <= BURST + 2 * LAST_LINES);
        assert_eq!(limiter.due(), None, "it would be due at once, for ever");
        limiter.finish();
        assert_eq!(accounted(&taken(&mut limiter)), 100_000);
    }
}
