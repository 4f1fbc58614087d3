/// @file
/// Log lines on standard error: conduit::log::info("{} tags in frame {}", count, frame).
///
/// Each line is one write, so that lines of several threads do not mix. The level is info by
/// default. The environment variable CONDUIT_LOG (debug, info, warn, error or off) sets another
/// one, and set_level() takes precedence. No function throws.
#pragma once

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <string>
#include <string_view>

#include <unistd.h>

#include "detail/format.hpp"

namespace conduit::log {

enum class Level { debug, info, warn, error, off };

namespace detail {

inline Level level_of_environment() noexcept {
  const char* text = std::getenv("CONDUIT_LOG");
  const std::string_view level = text == nullptr ? "" : text;
  if (level == "debug") return Level::debug;
  if (level == "warn") return Level::warn;
  if (level == "error") return Level::error;
  if (level == "off") return Level::off;
  return Level::info;
}

inline std::atomic<Level>& least_level() noexcept {
  static std::atomic<Level> level{level_of_environment()};
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

/// Writes a line. If the text cannot be formatted, writes the text and the reason.
template <class... Args>
void line(Level level, std::string_view name, std::string_view format,
          const Args&... args) noexcept {
  if (level < least_level().load(std::memory_order_relaxed)) return;
  try {
    std::string text(name);
    text += ": ";
    try {
      text += conduit::detail::format(format, args...);
    } catch (const std::exception& error) {
      text += std::string(format) + " [not formatted: " + error.what() + "]";
    }
    text += '\n';
    write_line(text);
  } catch (...) {
    write_line("error: could not format a log line\n");
  }
}

}  // namespace detail

/// Sets the level for all threads: lines of this level and above are written.
inline void set_level(Level level) noexcept {
  detail::least_level().store(level, std::memory_order_relaxed);
}

/// Returns the level.
inline Level level() noexcept { return detail::least_level().load(std::memory_order_relaxed); }

/// Writes a line of this level. The text has the syntax of std::format: `{}` is the next
/// argument, `{:.3f}`, `{:08x}` and `{:^10}` specify its format, `{{` and `}}` are braces. An
/// argument needs a formatter or an operator<< for std::ostream.
///
/// std::format formats the text if the standard library has it, otherwise {fmt} if it is
/// installed, otherwise a subset in these headers. If the text cannot be formatted, the line
/// contains the text and the reason.
template <class... Args>
void debug(std::string_view format, const Args&... args) noexcept {
  detail::line(Level::debug, "debug", format, args...);
}

template <class... Args>
void info(std::string_view format, const Args&... args) noexcept {
  detail::line(Level::info, "info", format, args...);
}

template <class... Args>
void warn(std::string_view format, const Args&... args) noexcept {
  detail::line(Level::warn, "warn", format, args...);
}

template <class... Args>
void error(std::string_view format, const Args&... args) noexcept {
  detail::line(Level::error, "error", format, args...);
}

}  // namespace conduit::log
