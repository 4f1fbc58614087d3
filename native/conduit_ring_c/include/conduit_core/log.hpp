/// One-line messages on standard error: conduit::log::info("{} tags in frame {}", count, frame).
///
/// Each line is written at once, so that lines of several threads do not mix. debug is off by default. set_level() sets
/// the least level that is written; until it is called, the environment variable CONDUIT_LOG does: debug, info, warn, error
/// or off. Nothing here throws.
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
  const std::string_view wish = text == nullptr ? "" : text;
  if (wish == "debug") return Level::debug;
  if (wish == "warn") return Level::warn;
  if (wish == "error") return Level::error;
  if (wish == "off") return Level::off;
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

/// A line whose text cannot be formatted is written all the same, with what is wrong with it.
template <class... Args>
void line(Level level, std::string_view name, std::string_view format, const Args&... args) noexcept {
  if (level < least_level().load(std::memory_order_relaxed)) return;
  try {
    std::string text(name);
    text += ": ";
    try {
      text += conduit::detail::format(format, args...);
    } catch (const std::exception& refused) {
      text += std::string(format) + " [not formatted: " + refused.what() + "]";
    }
    text += '\n';
    write_line(text);
  } catch (...) {
    write_line("error: a line could not be formatted\n");
  }
}

}  // namespace detail

/// Writes the lines of this level and those above it from now on, in all threads.
inline void set_level(Level level) noexcept { detail::least_level().store(level, std::memory_order_relaxed); }

/// The least level that is written.
inline Level level() noexcept { return detail::least_level().load(std::memory_order_relaxed); }

/// The text is that of std::format: `{}` stands for the next argument, `{:.3f}`, `{:08x}`, `{:^10}` say how, `{{` and `}}`
/// are braces. An argument may be anything that has a formatter or can be written to a std::ostream. std::format itself
/// formats where the library has it, else {fmt} where it is installed, else a part of it that is written here; what the
/// one at hand cannot do is refused, with the text and the reason in the line.
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
