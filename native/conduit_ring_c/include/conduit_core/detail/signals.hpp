/// @file
/// Handling of SIGINT and SIGTERM while nodes run.
#pragma once

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <mutex>

#include <sys/eventfd.h>
#include <unistd.h>

#include "error.hpp"

namespace conduit::detail {

/// A flag as a descriptor, which poll() reports as readable while the flag is raised.
class Flag {
public:
  Flag() : descriptor_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (descriptor_ < 0) throw Error(errno, "could not create an event descriptor");
  }
  ~Flag() { ::close(descriptor_); }
  Flag(const Flag&) = delete;
  Flag& operator=(const Flag&) = delete;

  /// Raises the flag. Signal handlers may call it.
  void raise() const noexcept { raise(descriptor_); }

  static void raise(int descriptor) noexcept {
    const int kept = errno;
    const std::uint64_t one = 1;
    // Fails only after 2^64 calls.
    [[maybe_unused]] const ssize_t written = ::write(descriptor, &one, sizeof one);
    errno = kept;
  }

  void lower() const noexcept {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t read = ::read(descriptor_, &count, sizeof count);
  }

  int descriptor() const noexcept { return descriptor_; }

private:
  int descriptor_;
};

inline std::atomic<int> signal_descriptor{-1};
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler reads it");

extern "C" inline void conduit_detail_on_signal(int) {
  Flag::raise(signal_descriptor.load());
}

/// Makes SIGINT and SIGTERM raise one flag, which all instances share. The last instance restores
/// the previous handlers.
class SignalWatch {
public:
  SignalWatch() {
    Shared& all = shared();
    const std::lock_guard<std::mutex> guard(all.mutex);
    if (all.watches++ > 0) return;
    signal_descriptor.store(all.flag.descriptor());
    struct sigaction action = {};
    action.sa_handler = conduit_detail_on_signal;
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    ::sigaction(SIGINT, &action, &all.old_interrupt);
    ::sigaction(SIGTERM, &action, &all.old_terminate);
  }

  ~SignalWatch() {
    Shared& all = shared();
    const std::lock_guard<std::mutex> guard(all.mutex);
    if (--all.watches > 0) return;
    ::sigaction(SIGINT, &all.old_interrupt, nullptr);
    ::sigaction(SIGTERM, &all.old_terminate, nullptr);
    all.flag.lower();
  }

  SignalWatch(const SignalWatch&) = delete;
  SignalWatch& operator=(const SignalWatch&) = delete;

  int descriptor() const noexcept { return shared().flag.descriptor(); }

private:
  struct Shared {
    std::mutex mutex;
    int watches = 0;
    Flag flag;
    struct sigaction old_interrupt = {};
    struct sigaction old_terminate = {};
  };

  /// Never destroyed: a handler may still run while the process exits.
  static Shared& shared() {
    static Shared& all = *new Shared;
    return all;
  }
};

}  // namespace conduit::detail
