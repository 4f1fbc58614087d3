/// What a subscriber reads.
#pragma once

#include <cstddef>
#include <cstdint>

#include <conduit_ring.h>

namespace conduit {

namespace detail {
class Reader;
}

/// A message. Its bytes are the subscriber's copy: they stay what they were whatever the publisher does meanwhile, until
/// that subscriber reads again. Copy what you want to keep longer.
class Message {
public:
  const void* data() const noexcept { return data_; }

  /// In bytes.
  std::size_t size() const noexcept { return meta_.size_bytes; }

  /// Messages of a topic count from 0.
  std::uint64_t sequence() const noexcept { return meta_.sequence; }

  /// When it was published, on CLOCK_MONOTONIC_RAW.
  std::uint64_t timestamp_ns() const noexcept { return meta_.timestamp_ns; }

  /// How many messages were lost just before it.
  std::uint64_t lost() const noexcept { return meta_.lost; }

private:
  friend class detail::Reader;

  Message(const void* data, const conduit_ring_meta& meta) noexcept : data_(data), meta_(meta) {}

  const void* data_;
  conduit_ring_meta meta_;
};

}  // namespace conduit
