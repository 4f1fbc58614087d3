/// @file
/// Formatting of log lines: std::format if the standard library has it, otherwise {fmt} if its
/// headers are installed, otherwise the subset in plain_format.hpp. A text that the formatter
/// does not support throws an exception; it is never printed wrongly.
#pragma once

#include <exception>
#include <locale>
#include <ostream>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#if defined(__has_include)
#if __has_include(<version>)
#include <version>
#endif
#endif

// CONDUIT_LOG_PLAIN_FORMAT selects the subset, which needs no library.
#if defined(CONDUIT_LOG_PLAIN_FORMAT)
#define CONDUIT_LOG_FORMAT_PLAIN 1
#elif defined(__cpp_lib_format)
#define CONDUIT_LOG_FORMAT_STD 1
#include <format>
#elif defined(__has_include)
#if __has_include(<fmt/format.h>)
#define CONDUIT_LOG_FORMAT_FMT 1
#ifndef FMT_HEADER_ONLY
#define FMT_HEADER_ONLY 1
#endif
#include <fmt/format.h>
#else
#define CONDUIT_LOG_FORMAT_PLAIN 1
#endif
#else
#define CONDUIT_LOG_FORMAT_PLAIN 1
#endif

#if defined(CONDUIT_LOG_FORMAT_PLAIN)
#include "plain_format.hpp"
#endif

namespace conduit::detail {

#if defined(CONDUIT_LOG_FORMAT_STD)
template <class T>
inline constexpr bool is_formattable = std::is_default_constructible_v<std::formatter<T, char>>;

template <class... Args>
std::string vformat(std::string_view text, const Args&... args) {
  return std::vformat(text, std::make_format_args(args...));
}
#elif defined(CONDUIT_LOG_FORMAT_FMT)
template <class T>
inline constexpr bool is_formattable = fmt::is_formattable<T, char>::value;

template <class... Args>
std::string vformat(std::string_view text, const Args&... args) {
  return fmt::vformat(fmt::string_view(text.data(), text.size()), fmt::make_format_args(args...));
}
#else
template <class T>
inline constexpr bool is_formattable = plain::is_formattable<T>;

template <class... Args>
std::string vformat(std::string_view text, const Args&... args) {
  return plain::vformat(text, {plain::Argument::of(args)...});
}
#endif

template <class T, class = void>
struct IsStreamable : std::false_type {};
template <class T>
struct IsStreamable<
    T, std::void_t<decltype(std::declval<std::ostream&>() << std::declval<const T&>())>>
    : std::true_type {};

template <class T>
std::string streamed(const T& value) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << value;
  return out.str();
}

/// Converts an argument to a type that all formatters support: a text to a view (a null pointer
/// to "(null)"), a value without a formatter by its operator<<, an enumerator without one to its
/// number.
template <class T>
decltype(auto) formattable(const T& value) {
  if constexpr (std::is_null_pointer_v<T>) {
    return std::string_view("(null)");
  } else if constexpr (std::is_convertible_v<const T&, const char*> && !std::is_class_v<T>) {
    const char* text = value;
    return text == nullptr ? std::string_view("(null)") : std::string_view(text);
  } else if constexpr (std::is_same_v<T, std::string>) {
    return std::string_view(value);
  } else if constexpr (std::is_enum_v<T>) {
    if constexpr (is_formattable<T>) return static_cast<const T&>(value);
    else if constexpr (IsStreamable<T>::value && !std::is_convertible_v<T, int>)
      return streamed(value);
    else return +static_cast<std::underlying_type_t<T>>(value);
  } else if constexpr (std::is_pointer_v<T>) {
    return static_cast<const void*>(value);
  } else if constexpr (is_formattable<T>) {
    return static_cast<const T&>(value);
  } else {
    static_assert(IsStreamable<T>::value,
                  "expected an argument with a formatter or an operator<< for std::ostream");
    return streamed(value);
  }
}

/// Binds a temporary for the duration of a call.
template <class T>
const T& as_reference(const T& value) {
  return value;
}

/// Formats a text with the syntax of std::format. Throws std::exception if that fails. Without
/// arguments, returns an invalid text unchanged.
template <class... Args>
std::string format(std::string_view text, const Args&... args) {
  if constexpr (sizeof...(Args) == 0) {
    try {
      return vformat(text);
    } catch (const std::exception&) {
      return std::string(text);
    }
  } else {
    return vformat(text, as_reference(formattable(args))...);
  }
}

}  // namespace conduit::detail
