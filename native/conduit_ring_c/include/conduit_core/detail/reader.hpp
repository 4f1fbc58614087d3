/// @file
/// A subscriber of conduit_ring.h with its buffer and its waker.
#pragma once

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include <conduit_ring.h>

#include "../message.hpp"
#include "error.hpp"

namespace conduit::detail {

/// Frees the handles of conduit_ring.h.
struct Release {
  void operator()(conduit_ring_subscriber* subscriber) const noexcept {
    conduit_ring_subscriber_close(subscriber);
  }
  void operator()(conduit_ring_message* message) const noexcept {
    conduit_ring_message_free(message);
  }
  void operator()(conduit_ring_waker* waker) const noexcept { conduit_ring_waker_free(waker); }
  void operator()(conduit_ring_lease* lease) const noexcept { conduit_ring_lease_release(lease); }
};

/// The result of a read. `nothing` means no event, a timeout or a wake-up.
enum class Event { nothing, message, publisher_up, publisher_down };

class Reader {
public:
  /// Opens a subscriber, without waiting for the topic.
  explicit Reader(const std::string& topic, std::uint32_t guard = CONDUIT_RING_GUARD_AUTO)
      : topic_(topic) {
    check_abi();
    conduit_ring_subscriber_options options = CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT;
    options.guard = guard;
    conduit_ring_subscriber* subscriber = nullptr;
    check(conduit_ring_subscriber_open(c_text(topic), &options, &subscriber));
    subscriber_.reset(subscriber);
    conduit_ring_message* buffer = nullptr;
    check(conduit_ring_message_new(&buffer));
    buffer_.reset(buffer);
    conduit_ring_waker* waker = nullptr;
    check(conduit_ring_subscriber_waker(subscriber, &waker));
    waker_.reset(waker);
  }

  /// Waits until the topic exists, or for a wake-up.
  void await_topic() {
    const int status =
        conduit_ring_subscriber_await_topic(subscriber_.get(), CONDUIT_RING_FOREVER);
    if (!is_nothing(status)) check(status);
  }

  Event try_read() {
    std::uint32_t event = 0;
    const int status =
        conduit_ring_subscriber_try_read(subscriber_.get(), buffer_.get(), &event);
    return to_event(status, event);
  }

  Event read(std::chrono::nanoseconds timeout) {
    std::uint32_t event = 0;
    const int status = conduit_ring_subscriber_read(subscriber_.get(), buffer_.get(),
                                                    count(timeout), &event);
    return to_event(status, event);
  }

  /// Sets `lease` if the result is Event::message.
  Event lease(std::chrono::nanoseconds timeout,
              std::unique_ptr<conduit_ring_lease, Release>& lease) {
    std::uint32_t event = 0;
    conduit_ring_lease* taken = nullptr;
    const int status =
        conduit_ring_subscriber_lease(subscriber_.get(), count(timeout), &taken, &event);
    lease.reset(taken);
    return to_event(status, event);
  }

  /// Returns the message. Valid after Event::message.
  Message message() const noexcept {
    return Message(conduit_ring_message_data(buffer_.get()),
                   conduit_ring_message_meta(buffer_.get()));
  }

  /// Ends the current read, or the next one. Any thread may call it.
  void wake() const noexcept { conduit_ring_waker_wake(waker_.get()); }

  const std::string& topic() const noexcept { return topic_; }

private:
  static std::uint64_t count(std::chrono::nanoseconds timeout) noexcept {
    return timeout.count() > 0 ? static_cast<std::uint64_t>(timeout.count()) : 0;
  }

  static bool is_nothing(int status) noexcept {
    return status == -EAGAIN || status == -ETIMEDOUT || status == -ECANCELED;
  }

  static Event to_event(int status, std::uint32_t event) {
    if (is_nothing(status)) return Event::nothing;
    check(status);
    switch (event) {
      case CONDUIT_RING_EVENT_MESSAGE: return Event::message;
      case CONDUIT_RING_EVENT_PUBLISHER_UP: return Event::publisher_up;
      default: return Event::publisher_down;
    }
  }

  std::string topic_;
  std::unique_ptr<conduit_ring_subscriber, Release> subscriber_;
  std::unique_ptr<conduit_ring_message, Release> buffer_;
  std::unique_ptr<conduit_ring_waker, Release> waker_;
};

}  // namespace conduit::detail
