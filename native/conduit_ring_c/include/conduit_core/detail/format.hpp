/// A small part of std::format, which C++17 lacks.
#pragma once

#include <cstddef>
#include <iomanip>
#include <ios>
#include <locale>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace conduit::detail {

/// What stands in `{:…}`: [[fill]<|>][#][0][width][.precision][type], type one of d x X o f e g s.
struct FormatSpec {
  char fill = ' ';
  char align = '\0';
  bool has_base = false;
  int width = 0;
  int precision = -1;
  char type = '\0';

  explicit FormatSpec(std::string_view text) {
    const auto is_align = [](char c) { return c == '<' || c == '>'; };
    if (text.size() >= 2 && is_align(text[1])) {
      fill = text[0];
      align = text[1];
      text.remove_prefix(2);
    } else if (!text.empty() && is_align(text[0])) {
      align = text[0];
      text.remove_prefix(1);
    }
    if (!text.empty() && text[0] == '#') {
      has_base = true;
      text.remove_prefix(1);
    }
    if (align == '\0' && !text.empty() && text[0] == '0') {
      fill = '0';
      align = '=';
    }
    width = number(text);
    if (!text.empty() && text[0] == '.') {
      text.remove_prefix(1);
      precision = number(text);
    }
    if (!text.empty()) type = text[0];
  }

private:
  static int number(std::string_view& text) {
    int value = 0;
    while (!text.empty() && text[0] >= '0' && text[0] <= '9') {
      if (value < 1000) value = value * 10 + (text[0] - '0');
      text.remove_prefix(1);
    }
    return value;
  }
};

inline void apply(std::ostream& out, const FormatSpec& spec) {
  if (spec.precision >= 0) out.precision(spec.precision);
  out.width(spec.width);
  out.fill(spec.fill);
  if (spec.has_base) out << std::showbase;
  if (spec.align == '<') out << std::left;
  if (spec.align == '>') out << std::right;
  if (spec.align == '=') out << std::internal;
  switch (spec.type) {
    case 'x': out << std::hex; break;
    case 'X': out << std::hex << std::uppercase; break;
    case 'o': out << std::oct; break;
    case 'f': out << std::fixed; break;
    case 'e': out << std::scientific; break;
    default: break;
  }
}

template <class T, class = void>
struct IsStreamable : std::false_type {};
template <class T>
struct IsStreamable<T, std::void_t<decltype(std::declval<std::ostream&>() << std::declval<const T&>())>>
    : std::true_type {};

/// Bytes are numbers, booleans words, enumerators their numbers, null texts "(null)".
template <class T>
void put(std::ostream& out, const FormatSpec& spec, const T& value) {
  apply(out, spec);
  if constexpr (std::is_same_v<T, bool>) {
    out << std::boolalpha << value;
  } else if constexpr (std::is_same_v<T, unsigned char> || std::is_same_v<T, signed char>) {
    out << static_cast<int>(value);
  } else if constexpr (std::is_same_v<T, char>) {
    if (spec.type == '\0' || spec.type == 'c') out << value;
    else out << static_cast<int>(value);
  } else if constexpr (std::is_convertible_v<const T&, const char*>) {
    const char* text = value;
    out << (text == nullptr ? "(null)" : text);
  } else if constexpr (std::is_enum_v<T> && !IsStreamable<T>::value) {
    out << +static_cast<std::underlying_type_t<T>>(value);
  } else if constexpr (std::is_null_pointer_v<T>) {
    out << "(null)";
  } else {
    static_assert(IsStreamable<T>::value, "an argument of a log line needs an operator<< for std::ostream");
    out << value;
  }
}

template <class T>
void append(std::string& text, const FormatSpec& spec, const T& value) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  if (std::is_floating_point_v<T> && spec.type == '\0') out.precision(std::is_same_v<T, float> ? 7 : 15);
  put(out, spec, value);
  text += out.str();
}

/// What was found: `{}` or `{:spec}`, and how it was written.
struct Placeholder {
  std::string_view spec;
  std::string_view written;
  bool found = false;
};

/// Copies what stands before the next placeholder, and takes it and the placeholder off `format`. Braces around anything
/// else are text.
inline Placeholder copy_to_placeholder(std::string& text, std::string_view& format) {
  while (!format.empty()) {
    const char c = format[0];
    const bool twice = format.size() > 1 && format[1] == c;
    const bool opens = c == '{' && !twice && format.size() > 1 && (format[1] == '}' || format[1] == ':');
    const std::size_t end = opens ? format.find('}') : std::string_view::npos;
    if (end != std::string_view::npos) {
      const std::string_view written = format.substr(0, end + 1);
      format.remove_prefix(end + 1);
      return {end > 1 ? written.substr(2, end - 2) : std::string_view(), written, true};
    }
    text += c;
    format.remove_prefix((c == '{' || c == '}') && twice ? 2 : 1);
  }
  return {};
}

template <class T>
void format_next(std::string& text, std::string_view& format, const T& value) {
  const Placeholder place = copy_to_placeholder(text, format);
  if (!place.found) text += ' ';
  append(text, FormatSpec(place.spec), value);
}

/// Arguments without a place follow at the end, and places without an argument stay: nothing is lost.
template <class... Args>
std::string format(std::string_view format, const Args&... args) {
  std::string text;
  (format_next(text, format, args), ...);
  for (;;) {
    const Placeholder place = copy_to_placeholder(text, format);
    if (!place.found) return text;
    text += place.written;
  }
}

}  // namespace conduit::detail
