/// @file
/// Logs the exceptions of a callback, at most one line per second.
#pragma once

#include <chrono>
#include <cstdint>
#include <exception>
#include <string>
#include <utility>

#include "../log.hpp"

namespace conduit::detail {

/// Calls functions and logs their exceptions under a name.
class ErrorLog {
public:
  explicit ErrorLog(std::string name) : name_(std::move(name)) {}

  /// Calls `call`. Returns true, or logs the exception and returns false.
  template <class Call>
  bool run(Call&& call) {
    try {
      call();
      return true;
    } catch (const std::exception& exception) {
      write(exception.what());
    } catch (...) {
      write("exception of a type other than std::exception");
    }
    return false;
  }

private:
  void write(const char* what) noexcept {
    const auto now = std::chrono::steady_clock::now();
    if (now < quiet_until_) {
      ++suppressed_;
      return;
    }
    quiet_until_ = now + std::chrono::seconds(1);
    if (suppressed_ == 0) log::error("{}: {}", name_, what);
    else log::error("{}: {} ({} more since the last line)", name_, what, suppressed_);
    suppressed_ = 0;
  }

  std::string name_;
  std::chrono::steady_clock::time_point quiet_until_{};
  std::uint64_t suppressed_ = 0;
};

}  // namespace conduit::detail
