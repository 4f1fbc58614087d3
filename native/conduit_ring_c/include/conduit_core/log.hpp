/// One-line messages on standard error: conduit::log::info("{} tags in frame {}", count, frame).
///
/// Each line is written at once, so that lines of several threads do not mix. debug is off by default; the environment
/// variable CONDUIT_LOG sets the least level that is written: debug, info, warn, error or off. Nothing here throws.
#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <string>
#include <string_view>

#include <unistd.h>

#include "detail/format.hpp"

namespace conduit::log {

namespace detail {

enum class Level { debug, info, warn, error, off };

inline Level least_level() noexcept {
  static const Level level = [] {
    const char* text = std::getenv("CONDUIT_LOG");
    const std::string_view wish = text == nullptr ? "" : text;
    if (wish == "debug") return Level::debug;
    if (wish == "warn") return Level::warn;
    if (wish == "error") return Level::error;
    if (wish == "off") return Level::off;
    return Level::info;
  }();
  return level;
}

inline void write_line(std::string_view line) noexcept {
  while (!line.empty()) {
    const ssize_t written = ::write(STDERR_FILENO, line.data(), line.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return;
    line.remove_prefix(static_cast<std::size_t>(written));
  }
}

template <class... Args>
void line(Level level, std::string_view name, std::string_view format, const Args&... args) noexcept {
  if (level < least_level()) return;
  try {
    std::string text(name);
    text += ": ";
    text += conduit::detail::format(format, args...);
    text += '\n';
    write_line(text);
  } catch (...) {
    write_line("error: a line could not be formatted\n");
  }
}

}  // namespace detail

/// `{}` stands for the next argument: anything that can be written to a std::ostream. `{:.3f}`, `{:08x}`, `{:>10}` and
/// the like work as in std::format; `{{` and `}}` are braces.
template <class... Args>
void debug(std::string_view format, const Args&... args) noexcept {
  detail::line(detail::Level::debug, "debug", format, args...);
}

template <class... Args>
void info(std::string_view format, const Args&... args) noexcept {
  detail::line(detail::Level::info, "info", format, args...);
}

template <class... Args>
void warn(std::string_view format, const Args&... args) noexcept {
  detail::line(detail::Level::warn, "warn", format, args...);
}

template <class... Args>
void error(std::string_view format, const Args&... args) noexcept {
  detail::line(detail::Level::error, "error", format, args...);
}

}  // namespace conduit::log
