/// @file
/// Topics in shared memory for C++17: one Publisher, many Subscribers, any process and language.
///
///     conduit::Publisher publisher("chatter");
///     conduit::Subscriber subscriber("chatter");
///     publisher.publish("hello", 5);
///     const conduit::Message message = subscriber.wait();
///
/// A thin layer over conduit_ring.h, which describes the ring. Errors are thrown as
/// conduit::Error, a std::system_error whose what() is a message and whose code() is the errno.
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

/// The slots of a topic. A message has up to slot_size - 20 bytes.
struct RingBufferConfig {
  /// A power of two. A subscriber that falls behind by more messages loses the oldest ones.
  std::uint32_t slot_count = 16;
  /// In bytes, including the slot's 20-byte header. The file rounds it up to a multiple of 64.
  std::uint32_t slot_size = 4096;
};

/// A lent slot from Publisher::loan(), in which a message is written in place. The publisher
/// publishes nothing else meanwhile. After the publisher's destruction data() may still be
/// written, and commit() throws.
class Loan {
public:
  Loan(Loan&&) noexcept = default;
  Loan& operator=(Loan&& other) noexcept = default;

  /// The memory to write to: size() bytes of any alignment, which contain older messages at
  /// first.
  void* data() const noexcept { return data_; }

  /// The size in bytes.
  std::size_t size() const noexcept { return size_; }

  /// Publishes the message and returns its sequence number. May be called once.
  std::uint64_t commit() { return commit(size_); }

  /// Publishes the first `size` bytes of the message and returns its sequence number.
  std::uint64_t commit(std::size_t size) {
    if (!lent_) throw Error(EINVAL, "loan was committed or moved from");
    std::uint64_t sequence = 0;
    detail::check(conduit_ring_publisher_commit(lent_.get(), size, &sequence));
    static_cast<void>(lent_.release());
    lent_.get_deleter().publisher.reset();
    return sequence;
  }

private:
  friend class Publisher;

  /// Cancels the loan. Keeps the publisher's handle open until then.
  struct Cancel {
    std::shared_ptr<conduit_ring_publisher> publisher;
    void operator()(conduit_ring_publisher* lent) const noexcept {
      conduit_ring_publisher_cancel(lent);
    }
  };

  Loan(std::shared_ptr<conduit_ring_publisher> publisher, void* data, std::size_t size) noexcept
      : lent_(publisher.get(), Cancel{publisher}), data_(data), size_(size) {}

  /// Null after the commit.
  std::unique_ptr<conduit_ring_publisher, Cancel> lent_;
  void* data_;
  std::size_t size_;
};

/// The publisher of a topic. Closes the topic on destruction. Several threads may use it at once.
///
/// If the topic's file is removed or replaced, the publisher creates it again within a second,
/// even while nothing is published. If that fails, publish() throws the reason.
class Publisher {
public:
  /// Creates the topic, or takes it over from a publisher that died. Throws while another
  /// publisher is alive.
  Publisher(const std::string& topic) : Publisher(topic, RingBufferConfig{}) {}

  Publisher(const std::string& topic, const RingBufferConfig& config)
      : Publisher(topic, config, 0) {}

  /// Publishes a copy of `size` bytes. Never waits. Returns false without publishing when the
  /// message does not fit into a slot, or when subscribers hold all slots.
  bool publish(const void* data, std::size_t size) {
    const int status = conduit_ring_publisher_publish(handle_.get(), data, size, nullptr);
    if (status == -EMSGSIZE || status == -EBUSY) return false;
    detail::check(status);
    return true;
  }

  /// Lends the next slot, in which a message of up to `size` bytes is written in place.
  /// Loan::commit() publishes it; a loan that is destroyed without a commit publishes nothing.
  /// Returns nothing when publish() would return false. Until the loan's end, publishing anything
  /// else throws.
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

  Publisher(const std::string& topic, const RingBufferConfig& config, std::uint32_t flags)
      : topic_(topic) {
    detail::check_abi();
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    options.flags = flags;
    options.geometry.slot_count = config.slot_count;
    options.geometry.slot_size_bytes = config.slot_size;
    conduit_ring_publisher* opened = nullptr;
    detail::check(conduit_ring_publisher_open(detail::c_text(topic), &options, &opened));
    std::shared_ptr<conduit_ring_publisher> shared(opened, conduit_ring_publisher_close);
    handle_ = Handle(opened, End{std::move(shared)});
  }

  /// Ends the topic. The handle closes when no loan shares it any more.
  struct End {
    std::shared_ptr<conduit_ring_publisher> shared;
    void operator()(conduit_ring_publisher* publisher) const noexcept {
      conduit_ring_publisher_end(publisher);
    }
  };
  using Handle = std::unique_ptr<conduit_ring_publisher, End>;

  std::string topic_;
  Handle handle_;
};

/// Whether to read a topic guarded, so that another user cannot end this process by truncating
/// the topic's file. See CONDUIT_RING_GUARD_AUTO.
enum class Guard : std::uint32_t {
  /// If the topic's file belongs to another user.
  automatic = CONDUIT_RING_GUARD_AUTO,
  always = CONDUIT_RING_GUARD_ALWAYS,
  /// All users who may write the file are trusted.
  never = CONDUIT_RING_GUARD_NEVER,
};

/// A message that is read in its slot of the ring, without a copy, until the lease is destroyed.
///
/// The publisher skips the slot meanwhile; it does not wait. If leases hold all slots, it drops
/// its new messages. So destroy a lease within slot_count - 1 periods of the topic. A lease may
/// outlive its subscriber, and any thread may use it.
class Lease {
public:
  /// The message's bytes, of any alignment.
  const void* data() const noexcept { return conduit_ring_lease_data(handle_.get()); }

  /// The size in bytes.
  std::size_t size() const noexcept { return meta().size_bytes; }

  /// As Message::sequence().
  std::uint64_t sequence() const noexcept { return meta().sequence; }

  /// As Message::timestamp_ns().
  std::uint64_t timestamp_ns() const noexcept { return meta().timestamp_ns; }

  /// As Message::lost().
  std::uint64_t lost() const noexcept { return meta().lost; }

  /// Whether the lease holds a slot. It is a copy if the publisher would not respect it: a legacy
  /// publisher, a guarded topic, or a message that is about to be overwritten.
  bool holds_slot() const noexcept { return conduit_ring_lease_holds_slot(handle_.get()); }

private:
  friend class Subscriber;
  using Handle = std::unique_ptr<conduit_ring_lease, detail::Release>;

  explicit Lease(Handle handle) noexcept : handle_(std::move(handle)) {}
  conduit_ring_meta meta() const noexcept { return conduit_ring_lease_meta(handle_.get()); }

  Handle handle_;
};

/// A subscriber of a topic. It reads all messages published from now on that are still in the
/// ring. One thread at a time may use it.
///
/// It outlives publishers: when a publisher dies or restarts, it continues with the next one.
class Subscriber {
public:
  /// Waits until the topic exists. Throws when the topic has 16 other subscribers.
  Subscriber(const std::string& topic) : Subscriber(topic, Guard::automatic) {}

  Subscriber(const std::string& topic, Guard guard)
      : reader_(topic, static_cast<std::uint32_t>(guard)) {
    reader_.await_topic();
  }

  /// Waits for the next message.
  Message wait() {
    for (;;) {
      if (auto message = wait_for(std::chrono::nanoseconds::max())) return *message;
    }
  }

  /// Returns the next message if there is one already.
  std::optional<Message> try_read() {
    for (;;) {
      const detail::Event event = reader_.try_read();
      if (event == detail::Event::message) return reader_.message();
      if (event == detail::Event::nothing) return std::nullopt;
    }
  }

  /// Waits for the next message, at most for `timeout`.
  std::optional<Message> wait_for(std::chrono::nanoseconds timeout) {
    const auto read = [this](auto left) { return reader_.read(left); };
    if (!read_until(timeout, read)) return std::nullopt;
    return reader_.message();
  }

  /// As wait(), without copying the message. Throws (EMFILE) when the subscriber holds three
  /// leases.
  Lease wait_lease() {
    for (;;) {
      if (auto lease = wait_lease_for(std::chrono::nanoseconds::max())) return std::move(*lease);
    }
  }

  /// As try_read(), without copying the message.
  std::optional<Lease> try_lease() { return wait_lease_for(std::chrono::nanoseconds::zero()); }

  /// As wait_for(), without copying the message.
  std::optional<Lease> wait_lease_for(std::chrono::nanoseconds timeout) {
    Lease::Handle handle;
    const auto lease = [&](auto left) { return reader_.lease(left, handle); };
    if (!read_until(timeout, lease)) return std::nullopt;
    return Lease(std::move(handle));
  }

  const std::string& topic() const noexcept { return reader_.topic(); }

private:
  /// Reads until a message arrives. Returns false after the timeout.
  template <class Read>
  static bool read_until(std::chrono::nanoseconds timeout, Read&& read) {
    using Clock = std::chrono::steady_clock;
    const bool endless = timeout > std::chrono::hours(24 * 365 * 100);
    const Clock::time_point deadline =
        endless ? Clock::time_point::max() : Clock::now() + timeout;
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
