/// @file
/// The errors of conduit_ring.h as exceptions.
#pragma once

#include <cerrno>
#include <string>
#include <system_error>
#include <utility>

#include <conduit_ring.h>

namespace conduit {

/// An error of the ring: what() is a message that names the topic, code() the errno (see
/// conduit_ring.h).
class Error : public std::system_error {
public:
  Error(int error_number, std::string message)
      : std::system_error(error_number, std::generic_category(), message),
        message_(std::move(message)) {}

  const char* what() const noexcept override { return message_.c_str(); }

private:
  std::string message_;
};

namespace detail {

/// Throws an Error for a negative status.
inline void check(int status) {
  if (status < 0) throw Error(-status, conduit_ring_last_error());
}

/// Throws an Error if the headers and the library have different ABI versions.
inline void check_abi() {
  const auto found = conduit_ring_abi_version();
  if (found == CONDUIT_RING_ABI_VERSION) return;
  throw Error(EPROTO, "expected ABI version " + std::to_string(CONDUIT_RING_ABI_VERSION) +
                          " of the library, as in conduit_ring.h, got: " +
                          std::to_string(found));
}

/// Returns a text for C. Throws an Error if it contains a NUL, at which C would end it.
inline const char* c_text(const std::string& text) {
  if (text.find('\0') == std::string::npos) return text.c_str();
  throw Error(EINVAL,
              "invalid topic: expected a name without NUL, got: " + std::string(text.c_str()));
}

}  // namespace detail
}  // namespace conduit
