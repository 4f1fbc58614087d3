/// @file
/// The message that a subscriber reads.
#pragma once

#include <cstddef>
#include <cstdint>

#include <conduit_ring.h>

namespace conduit {

namespace detail {
class Reader;
}

/// A message. Its bytes are the subscriber's own copy: they do not change, whatever the publisher
/// does, until that subscriber reads again. Copy them to keep them longer.
class Message {
public:
  /// The message's bytes.
  const void* data() const noexcept { return data_; }

  /// The size in bytes.
  std::size_t size() const noexcept { return meta_.size_bytes; }

  /// The sequence number, which starts at 0 for each topic.
  std::uint64_t sequence() const noexcept { return meta_.sequence; }

  /// The time of publication by CLOCK_MONOTONIC_RAW.
  std::uint64_t timestamp_ns() const noexcept { return meta_.timestamp_ns; }

  /// The number of messages that were lost just before this one.
  std::uint64_t lost() const noexcept { return meta_.lost; }

private:
  friend class detail::Reader;

  Message(const void* data, const conduit_ring_meta& meta) noexcept : data_(data), meta_(meta) {}

  const void* data_;
  conduit_ring_meta meta_;
};

}  // namespace conduit
