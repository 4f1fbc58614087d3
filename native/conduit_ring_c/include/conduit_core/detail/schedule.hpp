/// When a loop ticks.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace conduit::detail {

/// Deadlines at whole periods after the start, so that lateness does not add up. A tick that is late comes at once; those
/// that were missed altogether are left out.
class Schedule {
public:
  using Clock = std::chrono::steady_clock;

  Schedule(double hz, Clock::time_point start) : period_ns_(1e9 / checked(hz)), start_(start) {}

  static double checked(double hz) {
    if (std::isfinite(hz) && hz > 1e-9 && hz <= 1e9) return hz;
    throw std::invalid_argument("a loop was given " + std::to_string(hz) + " Hz; accepted are rates above 0, up to 1e9");
  }

  /// The deadline of the next tick, seen at `now`.
  Clock::time_point next(Clock::time_point now) {
    const std::chrono::duration<double, std::nano> passed = now - start_;
    const auto due = static_cast<std::int64_t>(passed.count() / period_ns_);
    ticks_ = due > ticks_ ? due : ticks_ + 1;
    return start_ + std::chrono::nanoseconds(static_cast<std::int64_t>(static_cast<double>(ticks_) * period_ns_));
  }

private:
  double period_ns_;
  Clock::time_point start_;
  std::int64_t ticks_ = 0;
};

}  // namespace conduit::detail
