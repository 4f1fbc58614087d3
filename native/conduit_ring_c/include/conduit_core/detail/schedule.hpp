/// @file
/// The times at which a loop ticks.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace conduit::detail {

/// Deadlines at whole periods after the start, so that delays do not add up. A late tick is due
/// at once; ticks that were missed by a whole period are skipped.
class Schedule {
public:
  using Clock = std::chrono::steady_clock;

  Schedule(double hz, Clock::time_point start) : period_ns_(1e9 / checked(hz)), start_(start) {}

  /// Returns the rate, or throws std::invalid_argument.
  static double checked(double hz) {
    if (std::isfinite(hz) && hz > 1e-9 && hz <= 1e9) return hz;
    throw std::invalid_argument("invalid rate of a loop: expected Hz above 0, up to 1e9, got: " +
                                std::to_string(hz));
  }

  /// Returns the deadline of the next tick, as of `now`.
  Clock::time_point next(Clock::time_point now) {
    const std::chrono::duration<double, std::nano> passed = now - start_;
    const auto due = static_cast<std::int64_t>(passed.count() / period_ns_);
    ticks_ = due > ticks_ ? due : ticks_ + 1;
    const double after_start_ns = static_cast<double>(ticks_) * period_ns_;
    return start_ + std::chrono::nanoseconds(static_cast<std::int64_t>(after_start_ns));
  }

private:
  double period_ns_;
  Clock::time_point start_;
  std::int64_t ticks_ = 0;
};

}  // namespace conduit::detail
