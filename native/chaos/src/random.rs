//! Pseudorandom numbers (SplitMix64). With the same seed a run makes the same choices, as far as
//! the scheduler permits.

use std::hash::{BuildHasher, RandomState};
use std::time::Duration;

/// A generator of pseudorandom numbers.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// Returns a generator with this seed.
    pub fn new(seed: u64) -> Random {
        Random { state: seed }
    }

    /// Returns a random seed.
    pub fn seed() -> u64 {
        RandomState::new().hash_one(std::process::id()) >> 32
    }

    /// Returns the next number.
    pub fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Returns a number of `0..bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    /// Returns `true` once in `n` times on average.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    /// Returns a duration of at most `longest`.
    pub fn up_to(&mut self, longest: Duration) -> Duration {
        Duration::from_micros(self.below(longest.as_micros() as u64 + 1))
    }

    /// Returns a length of `least..=most`. Each power of two is equally likely as a bound, so
    /// small lengths are frequent.
    pub fn length(&mut self, least: usize, most: usize) -> usize {
        let span = (most - least + 1) as u64;
        let bits = u64::from(span.ilog2()) + 1;
        let scale = 1 << self.below(bits + 1);
        least + self.below(span.min(scale)) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_reach_both_bounds_and_do_not_exceed_them() {
        let mut random = Random::new(1);
        let lengths: Vec<_> = (0..20_000).map(|_| random.length(36, 100)).collect();
        assert_eq!(lengths.iter().min(), Some(&36));
        assert_eq!(lengths.iter().max(), Some(&100));
    }

    #[test]
    fn the_same_seed_gives_the_same_numbers() {
        let numbers = |seed| {
            let mut random = Random::new(seed);
            [random.next(), random.below(7), random.next()]
        };
        assert_eq!(numbers(5), numbers(5));
        assert_ne!(numbers(5), numbers(6));
    }
}
