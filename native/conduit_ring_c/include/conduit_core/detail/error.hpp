/// Errors of conduit_ring.h as exceptions.
#pragma once

#include <cerrno>
#include <string>
#include <system_error>

#include <conduit_ring.h>

namespace conduit {

/// What went wrong: what() is a sentence that names the topic, code() the errno (see conduit_ring.h).
class Error : public std::system_error {
public:
  Error(int error_number, std::string sentence)
      : std::system_error(error_number, std::generic_category(), sentence), sentence_(std::move(sentence)) {}

  const char* what() const noexcept override { return sentence_.c_str(); }

private:
  std::string sentence_;
};

namespace detail {

/// Throws for a negative status.
inline void check(int status) {
  if (status < 0) throw Error(-status, conduit_ring_last_error());
}

/// Throws when these headers and the library do not belong together.
inline void check_abi() {
  const auto found = conduit_ring_abi_version();
  if (found == CONDUIT_RING_ABI_VERSION) return;
  throw Error(EPROTO, "compiled with version " + std::to_string(CONDUIT_RING_ABI_VERSION) +
                          " of conduit_ring.h, but version " + std::to_string(found) + " of the library is there");
}

/// A text for C. One with a NUL inside would be taken for its beginning.
inline const char* c_text(const std::string& text) {
  if (text.find('\0') == std::string::npos) return text.c_str();
  throw Error(EINVAL, "a topic's name has a NUL inside: " + std::string(text.c_str()));
}

}  // namespace detail
}  // namespace conduit
