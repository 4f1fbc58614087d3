//! The angular speed of the inertial measurement unit during the last second.

use std::collections::VecDeque;

/// The age at which a sample is dropped, relative to the newest one.
const KEPT_NS: u64 = 1_000_000_000;

/// The most samples kept, whatever their rate.
const MOST_SAMPLES: usize = 4096;

/// The farthest distance of a sample from the time in question.
const REACH_NS: u64 = 100_000_000;

/// The longest delay between a sample and its publication for which its stamp is trusted.
const LONGEST_DELAY_NS: i128 = 1_000_000_000;

#[derive(Debug, Clone, Copy)]
struct Sample {
    time_ns: u64,
    angular_velocity: [f64; 3],
}

/// The samples of the last second. All times are of `CLOCK_MONOTONIC_RAW`.
#[derive(Debug, Clone, Default)]
pub struct Motion {
    samples: VecDeque<Sample>,
}

impl Motion {
    /// Adds a sample in rad/s. Ignores a sample that is not a number. A sample that is older than
    /// others means that the clock was reset; it replaces the later ones.
    pub fn push(&mut self, time_ns: u64, angular_velocity: [f64; 3]) {
        if !angular_velocity.iter().all(|part| part.is_finite()) {
            return;
        }
        let later = self
            .samples
            .partition_point(|sample| sample.time_ns < time_ns);
        self.samples.truncate(later);
        self.samples.push_back(Sample {
            time_ns,
            angular_velocity,
        });
        let oldest = time_ns.saturating_sub(KEPT_NS);
        while self.samples.len() > MOST_SAMPLES || self.samples[0].time_ns < oldest {
            self.samples.pop_front();
        }
    }

    /// Returns the angular speed at a time in rad/s: interpolated if the samples around it are
    /// both within 100 ms, or else that of the nearest sample within 100 ms.
    pub fn angular_speed_at(&self, time_ns: u64) -> Option<f64> {
        let next = self
            .samples
            .partition_point(|sample| sample.time_ns < time_ns);
        let near = |index: usize| {
            let sample = self.samples.get(index)?;
            (sample.time_ns.abs_diff(time_ns) <= REACH_NS).then_some(*sample)
        };
        let before = next.checked_sub(1).and_then(near);
        let angular_velocity = match (before, near(next)) {
            (Some(before), Some(after)) => interpolate(before, after, time_ns),
            (one, other) => one.or(other)?.angular_velocity,
        };
        Some(norm(angular_velocity))
    }
}

fn interpolate(before: Sample, after: Sample, time_ns: u64) -> [f64; 3] {
    let span = (after.time_ns - before.time_ns) as f64;
    let t = (time_ns - before.time_ns) as f64 / span;
    std::array::from_fn(|axis| {
        let (from, to) = (before.angular_velocity[axis], after.angular_velocity[axis]);
        from + (to - from) * t
    })
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Converts a sample's wall-time stamp to `CLOCK_MONOTONIC_RAW`. `realtime_offset_ns` is the
/// difference from that clock to wall time. Returns the time of publication if the stamp is not
/// within a second before it, as it is after the clock was set or in a recording.
pub fn sample_time_ns(stamp_unix_ns: i64, published_ns: u64, realtime_offset_ns: i64) -> u64 {
    let time_ns = i128::from(stamp_unix_ns) - i128::from(realtime_offset_ns);
    let delay_ns = i128::from(published_ns) - time_ns;
    match u64::try_from(time_ns) {
        Ok(time_ns) if (0..=LONGEST_DELAY_NS).contains(&delay_ns) => time_ns,
        _ => published_ns,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn motion(samples: &[(u64, [f64; 3])]) -> Motion {
        let mut motion = Motion::default();
        for &(ms, angular_velocity) in samples {
            motion.push(ms * MS, angular_velocity);
        }
        motion
    }

    fn speed(motion: &Motion, ms: u64) -> Option<f64> {
        motion.angular_speed_at(ms * MS)
    }

    #[test]
    fn the_velocity_between_two_samples_is_interpolated_axis_by_axis() {
        let motion = motion(&[(1000, [0.0, 0.0, 2.0]), (1010, [0.0, 8.0, 8.0])]);
        assert_eq!(speed(&motion, 1005), Some((16.0f64 + 25.0).sqrt()));
        assert_eq!(speed(&motion, 1000), Some(2.0));
        assert_eq!(speed(&motion, 1010), Some(128.0f64.sqrt()));
    }

    #[test]
    fn outside_all_samples_the_nearest_one_within_100_ms_counts() {
        let motion = motion(&[(1000, [3.0, 4.0, 0.0]), (1010, [1.0, 0.0, 0.0])]);
        assert_eq!(speed(&motion, 900), Some(5.0));
        assert_eq!(speed(&motion, 899), None);
        assert_eq!(speed(&motion, 1110), Some(1.0));
        assert_eq!(speed(&motion, 1111), None);
    }

    #[test]
    fn nothing_is_interpolated_across_a_pause() {
        let motion = motion(&[(1000, [1.0, 0.0, 0.0]), (1500, [9.0, 0.0, 0.0])]);
        assert_eq!(speed(&motion, 1090), Some(1.0));
        assert_eq!(speed(&motion, 1250), None);
        assert_eq!(speed(&motion, 1450), Some(9.0));
    }

    #[test]
    fn without_samples_nothing_is_known() {
        assert_eq!(speed(&Motion::default(), 1), None);
    }

    #[test]
    fn a_sample_is_kept_for_a_second() {
        let motion = motion(&[(1000, [1.0; 3]), (1999, [2.0; 3]), (2001, [3.0; 3])]);
        assert_eq!(speed(&motion, 950), None);
        assert_eq!(motion.samples.len(), 2);
    }

    #[test]
    fn the_number_of_samples_is_bounded_at_any_rate() {
        let mut motion = Motion::default();
        for ns in 0..10_000 {
            motion.push(ns, [0.0; 3]);
        }
        assert_eq!(motion.samples.len(), MOST_SAMPLES);
    }

    #[test]
    fn an_older_sample_replaces_the_later_ones() {
        let motion = motion(&[
            (1000, [1.0, 0.0, 0.0]),
            (1010, [2.0, 0.0, 0.0]),
            (990, [7.0, 0.0, 0.0]),
        ]);
        assert_eq!(speed(&motion, 1010), Some(7.0));
    }

    #[test]
    fn a_sample_that_is_not_a_number_is_ignored() {
        let motion = motion(&[(1000, [1.0, 0.0, 0.0]), (1001, [f64::NAN, 0.0, 0.0])]);
        assert_eq!(speed(&motion, 1001), Some(1.0));
    }

    #[test]
    fn a_stamp_in_wall_time_is_converted_to_the_monotonic_clock() {
        let offset = 1_700_000_000_000_000_000;
        assert_eq!(sample_time_ns(offset + 5_000, 6_000, offset), 5_000);
    }

    #[test]
    fn an_impossible_stamp_is_replaced_by_the_time_of_publication() {
        let offset = 1_700_000_000_000_000_000;
        let published = 50_000_000_000;
        for stamp in [0, offset, offset + 50_000_000_001, i64::MAX, i64::MIN] {
            assert_eq!(sample_time_ns(stamp, published, offset), published);
        }
    }
}
