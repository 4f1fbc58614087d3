/// Topics in shared memory for C++17: one Publisher, many Subscribers, any process and language.
///
/// Thin over conduit_ring.h, which says how the ring behaves. What goes wrong is thrown as conduit::Error, which is a
/// std::system_error whose what() is a sentence and whose code() is the errno.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <conduit_ring.h>

#include "detail/error.hpp"
#include "detail/reader.hpp"
#include "message.hpp"

namespace conduit {

/// How a topic's slots are laid out. A message has up to slot_size - 20 bytes.
struct RingBufferConfig {
  /// A power of two. A subscriber that is slower than the publisher by so many messages loses the oldest.
  std::uint32_t slot_count = 16;
  /// In bytes, the slot's 20-byte header included. Rounded up to a multiple of 64.
  std::uint32_t slot_size = 4096;
};

/// The one publisher of a topic. Closes it when destroyed. May be used by several threads at once.
class Publisher {
public:
  /// Makes the topic, or goes on with it where a publisher that died left it. Throws while another publisher lives.
  Publisher(const std::string& topic) : Publisher(topic, RingBufferConfig{}) {}

  Publisher(const std::string& topic, const RingBufferConfig& config) : topic_(topic) {
    detail::check_abi();
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    options.geometry.slot_count = config.slot_count;
    options.geometry.slot_size_bytes = config.slot_size;
    conduit_ring_publisher* opened = nullptr;
    detail::check(conduit_ring_publisher_open(detail::c_text(topic), &options, &opened));
    handle_.reset(opened);
  }

  /// Publishes a copy of `size` bytes. Never waits. False, and nothing is published, when they do not fit into a slot, or
  /// while a subscriber holds the slot.
  bool publish(const void* data, std::size_t size) {
    const int status = conduit_ring_publisher_publish(handle_.get(), data, size, nullptr);
    if (status == -EMSGSIZE || status == -EBUSY) return false;
    detail::check(status);
    return true;
  }

  const std::string& topic() const noexcept { return topic_; }

private:
  struct Close {
    void operator()(conduit_ring_publisher* publisher) const noexcept { conduit_ring_publisher_close(publisher); }
  };

  std::string topic_;
  std::unique_ptr<conduit_ring_publisher, Close> handle_;
};

/// One reader of a topic: messages published from now on, each one that is still there. May be used by one thread at a
/// time.
///
/// It outlives publishers: when one dies or is restarted, reading goes on with the next one by itself.
class Subscriber {
public:
  /// Waits until the topic exists. Throws when 16 others read it.
  Subscriber(const std::string& topic) : reader_(topic) { reader_.await_topic(); }

  /// Waits for the next message.
  Message wait() {
    for (;;) {
      if (auto message = wait_for(std::chrono::nanoseconds::max())) return *message;
    }
  }

  /// The next message, if it is there already.
  std::optional<Message> try_read() {
    for (;;) {
      const detail::Event event = reader_.try_read();
      if (event == detail::Event::message) return reader_.message();
      if (event == detail::Event::nothing) return std::nullopt;
    }
  }

  /// Waits for the next message, but not longer than `timeout`.
  std::optional<Message> wait_for(std::chrono::nanoseconds timeout) {
    using Clock = std::chrono::steady_clock;
    const bool endless = timeout > std::chrono::hours(24 * 365 * 100);
    const Clock::time_point deadline = endless ? Clock::time_point::max() : Clock::now() + timeout;
    for (;;) {
      const std::chrono::nanoseconds left = endless ? timeout : deadline - Clock::now();
      const detail::Event event = reader_.read(left);
      if (event == detail::Event::message) return reader_.message();
      if (event == detail::Event::nothing) return std::nullopt;
    }
  }

  const std::string& topic() const noexcept { return reader_.topic(); }

private:
  detail::Reader reader_;
};

}  // namespace conduit
