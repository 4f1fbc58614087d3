/// Topics in shared memory for C++17: one Publisher, many Subscribers, any process and language.
///
/// Thin over conduit_ring.h, which says how the ring behaves. What goes wrong is thrown as conduit::Error, which is a
/// std::system_error whose what() is a sentence and whose code() is the errno.
#pragma once

#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

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

/// A slot that is being filled, from Publisher::loan(): the message is written where it will be read. Its publisher
/// publishes nothing else meanwhile. When the publisher is gone, data() may still be written, and commit() throws.
class Loan {
public:
  Loan(Loan&&) noexcept = default;
  Loan& operator=(Loan&& other) noexcept = default;

  /// Where to write: size() bytes of any alignment, which hold older messages until they are overwritten.
  void* data() const noexcept { return data_; }

  /// In bytes.
  std::size_t size() const noexcept { return size_; }

  /// Publishes the message, or its first `size` bytes, and returns its sequence number. Once.
  std::uint64_t commit() { return commit(size_); }
  std::uint64_t commit(std::size_t size) {
    if (!lent_) throw Error(EINVAL, "the loan was committed or moved from");
    std::uint64_t sequence = 0;
    detail::check(conduit_ring_publisher_commit(lent_.get(), size, &sequence));
    static_cast<void>(lent_.release());
    lent_.get_deleter().publisher.reset();
    return sequence;
  }

private:
  friend class Publisher;

  /// Cancels the loan, and keeps the handle until then.
  struct Cancel {
    std::shared_ptr<conduit_ring_publisher> publisher;
    void operator()(conduit_ring_publisher* lent) const noexcept { conduit_ring_publisher_cancel(lent); }
  };

  Loan(std::shared_ptr<conduit_ring_publisher> publisher, void* data, std::size_t size) noexcept
      : lent_(publisher.get(), Cancel{publisher}), data_(data), size_(size) {}

  /// Null once it is committed.
  std::unique_ptr<conduit_ring_publisher, Cancel> lent_;
  void* data_;
  std::size_t size_;
};

/// The one publisher of a topic. Closes it when destroyed. May be used by several threads at once. A topic's file that is
/// removed or replaced is made anew within a second, also while nothing is published; what cannot be is thrown by publish().
class Publisher {
public:
  /// Makes the topic, or goes on with it where a publisher that died left it. Throws while another publisher lives.
  Publisher(const std::string& topic) : Publisher(topic, RingBufferConfig{}) {}

  Publisher(const std::string& topic, const RingBufferConfig& config) : Publisher(topic, config, 0) {}

  /// Publishes a copy of `size` bytes. Never waits. False, and nothing is published, when they do not fit into a slot, or
  /// while a subscriber holds the slot.
  bool publish(const void* data, std::size_t size) {
    const int status = conduit_ring_publisher_publish(handle_.get(), data, size, nullptr);
    if (status == -EMSGSIZE || status == -EBUSY) return false;
    detail::check(status);
    return true;
  }

  /// Lends the next slot, for a message of up to `size` bytes that is written in place. Nothing is published before
  /// Loan::commit(); a loan that is destroyed without it publishes nothing. Nothing is lent where publish() would be false.
  /// Until the loan is gone, publishing anything else throws.
  std::optional<Loan> loan(std::size_t size) {
    void* data = nullptr;
    const int status = conduit_ring_publisher_loan(handle_.get(), size, &data);
    if (status == -EMSGSIZE || status == -EBUSY) return std::nullopt;
    detail::check(status);
    return Loan(handle_.get_deleter().shared, data, size);
  }

  const std::string& topic() const noexcept { return topic_; }

private:
  friend class Node;

  Publisher(const std::string& topic, const RingBufferConfig& config, std::uint32_t flags) : topic_(topic) {
    detail::check_abi();
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    options.flags = flags;
    options.geometry.slot_count = config.slot_count;
    options.geometry.slot_size_bytes = config.slot_size;
    conduit_ring_publisher* opened = nullptr;
    detail::check(conduit_ring_publisher_open(detail::c_text(topic), &options, &opened));
    handle_ = Handle(opened, End{std::shared_ptr<conduit_ring_publisher>(opened, conduit_ring_publisher_close)});
  }

  /// Ends the topic. The handle is closed when no loan shares it any more.
  struct End {
    std::shared_ptr<conduit_ring_publisher> shared;
    void operator()(conduit_ring_publisher* publisher) const noexcept { conduit_ring_publisher_end(publisher); }
  };
  using Handle = std::unique_ptr<conduit_ring_publisher, End>;

  std::string topic_;
  Handle handle_;
};

/// Whether to read a topic without touching memory that another process could take away: see CONDUIT_RING_GUARD_AUTO.
enum class Guard : std::uint32_t {
  /// When the topic's file belongs to another user.
  automatic = CONDUIT_RING_GUARD_AUTO,
  always = CONDUIT_RING_GUARD_ALWAYS,
  /// All who may write the file are trusted.
  never = CONDUIT_RING_GUARD_NEVER,
};

/// A message that stays where it lies, in its slot of the ring, until the lease is destroyed. The publisher leaves the slot
/// alone meanwhile, and does not wait: when it comes to this slot again, it drops its new messages. So destroy it within
/// slot_count - 1 periods of the topic. It may outlive its subscriber and go to other threads.
class Lease {
public:
  /// Of any alignment.
  const void* data() const noexcept { return conduit_ring_lease_data(handle_.get()); }

  /// In bytes.
  std::size_t size() const noexcept { return meta().size_bytes; }

  /// As of Message.
  std::uint64_t sequence() const noexcept { return meta().sequence; }
  std::uint64_t timestamp_ns() const noexcept { return meta().timestamp_ns; }
  std::uint64_t lost() const noexcept { return meta().lost; }

  /// Whether the publisher leaves a slot alone for it. It is a copy where none would: a legacy publisher, a guarded topic,
  /// a message that is about to be overwritten.
  bool holds_slot() const noexcept { return conduit_ring_lease_holds_slot(handle_.get()); }

private:
  friend class Subscriber;
  using Handle = std::unique_ptr<conduit_ring_lease, detail::Release>;

  explicit Lease(Handle handle) noexcept : handle_(std::move(handle)) {}
  conduit_ring_meta meta() const noexcept { return conduit_ring_lease_meta(handle_.get()); }

  Handle handle_;
};

/// One reader of a topic: messages published from now on, each one that is still there. May be used by one thread at a
/// time.
///
/// It outlives publishers: when one dies or is restarted, reading goes on with the next one by itself.
class Subscriber {
public:
  /// Waits until the topic exists. Throws when 16 others read it.
  Subscriber(const std::string& topic) : Subscriber(topic, Guard::automatic) {}

  Subscriber(const std::string& topic, Guard guard) : reader_(topic, static_cast<std::uint32_t>(guard)) {
    reader_.await_topic();
  }

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
    if (!in_time(timeout, [this](auto left) { return reader_.read(left); })) return std::nullopt;
    return reader_.message();
  }

  /// As wait(), try_read() and wait_for(), without copying the message. Throw (EMFILE) when three leases are held already.
  Lease wait_lease() {
    for (;;) {
      if (auto lease = wait_lease_for(std::chrono::nanoseconds::max())) return std::move(*lease);
    }
  }

  std::optional<Lease> try_lease() { return wait_lease_for(std::chrono::nanoseconds::zero()); }

  std::optional<Lease> wait_lease_for(std::chrono::nanoseconds timeout) {
    Lease::Handle handle;
    if (!in_time(timeout, [&](auto left) { return reader_.lease(left, handle); })) return std::nullopt;
    return Lease(std::move(handle));
  }

  const std::string& topic() const noexcept { return reader_.topic(); }

private:
  /// Reads until a message comes: true, or the time is up.
  template <class Read>
  static bool in_time(std::chrono::nanoseconds timeout, Read&& read) {
    using Clock = std::chrono::steady_clock;
    const bool endless = timeout > std::chrono::hours(24 * 365 * 100);
    const Clock::time_point deadline = endless ? Clock::time_point::max() : Clock::now() + timeout;
    for (;;) {
      const std::chrono::nanoseconds left = endless ? timeout : deadline - Clock::now();
      const detail::Event event = read(left);
      if (event == detail::Event::message) return true;
      if (event == detail::Event::nothing) return false;
    }
  }

  detail::Reader reader_;
};

}  // namespace conduit
