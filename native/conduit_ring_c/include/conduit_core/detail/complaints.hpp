/// What goes wrong again and again, said once a second.
#pragma once

#include <chrono>
#include <cstdint>
#include <exception>
#include <string>
#include <utility>

#include "../log.hpp"

namespace conduit::detail {

class Complaints {
public:
  explicit Complaints(std::string who) : who_(std::move(who)) {}

  /// Calls and logs what is thrown. True if nothing was.
  template <class Call>
  bool logged(Call&& call) {
    try {
      call();
      return true;
    } catch (const std::exception& thrown) {
      say(thrown.what());
    } catch (...) {
      say("something that is no std::exception was thrown");
    }
    return false;
  }

private:
  void say(const char* what) noexcept {
    const auto now = std::chrono::steady_clock::now();
    if (now < quiet_until_) {
      ++unsaid_;
      return;
    }
    quiet_until_ = now + std::chrono::seconds(1);
    if (unsaid_ == 0) log::error("{}: {}", who_, what);
    else log::error("{}: {} ({} more since the last line)", who_, what, unsaid_);
    unsaid_ = 0;
  }

  std::string who_;
  std::chrono::steady_clock::time_point quiet_until_{};
  std::uint64_t unsaid_ = 0;
};

}  // namespace conduit::detail
