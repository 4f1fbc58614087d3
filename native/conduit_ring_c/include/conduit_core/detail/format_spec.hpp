/// @file
/// An argument and its format specification, for plain_format.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace conduit::detail::plain {

/// An error in a text, or a feature that the subset does not support.
class FormatError : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

template <class T>
inline constexpr bool is_formattable =
    std::is_arithmetic_v<T> || std::is_same_v<T, std::string> ||
    std::is_same_v<T, std::string_view> || std::is_same_v<T, const void*> ||
    std::is_same_v<T, void*>;

/// Returns whether a byte continues a UTF-8 character.
inline bool continues_character(char c) {
  return (static_cast<unsigned char>(c) & 0xC0U) == 0x80U;
}

/// An argument of any type.
struct Argument {
  enum class Kind { boolean, character, integer, real, text, pointer };

  Kind kind = Kind::integer;
  bool negative = false;
  std::uint64_t magnitude = 0;
  long double real = 0;
  /// The number of significant digits that distinguishes all values of the real's type.
  int digits = 0;
  std::string_view text;

  template <class T>
  static Argument of(const T& value) {
    Argument argument;
    if constexpr (std::is_same_v<T, bool>) {
      argument.kind = Kind::boolean;
      argument.magnitude = value ? 1 : 0;
    } else if constexpr (std::is_same_v<T, char>) {
      argument.kind = Kind::character;
      argument.set(value);
    } else if constexpr (std::is_integral_v<T>) {
      argument.set(value);
    } else if constexpr (std::is_floating_point_v<T>) {
      argument.kind = Kind::real;
      argument.real = static_cast<long double>(value);
      argument.digits = std::is_same_v<T, float> ? 9 : std::is_same_v<T, double> ? 17 : 21;
    } else if constexpr (std::is_pointer_v<T>) {
      argument.kind = Kind::pointer;
      argument.magnitude = static_cast<std::uint64_t>(reinterpret_cast<std::uintptr_t>(value));
    } else {
      argument.kind = Kind::text;
      argument.text = value;
    }
    return argument;
  }

private:
  template <class T>
  void set(T value) {
    negative = std::is_signed_v<T> && value < T{};
    magnitude = static_cast<std::uint64_t>(value);
    if (negative) magnitude = 0 - magnitude;
  }
};

/// A format specification: the part after the colon.
struct Spec {
  std::string fill = " ";
  char align = '\0';
  char sign = '-';
  bool alternate = false;
  bool zero = false;
  std::size_t width = 0;
  int precision = -1;
  char type = '\0';

  explicit Spec(std::string_view text) : whole_(text) {
    take_fill(text);
    if (!text.empty() && is_one_of(text[0], "+- ")) sign = take(text);
    if (!text.empty() && text[0] == '#') alternate = take(text) == '#';
    if (!text.empty() && text[0] == '0') zero = take(text) == '0';
    width = static_cast<std::size_t>(number(text));
    if (!text.empty() && text[0] == '.') {
      take(text);
      if (text.empty() || !is_digit(text[0])) fail("expected digits after the point");
      precision = number(text);
    }
    if (!text.empty() && is_one_of(text[0], "bBcdoxXaAeEfFgGsp")) type = take(text);
    if (!text.empty()) fail("not supported");
  }

  /// Throws a FormatError for this specification.
  [[noreturn]] void fail(const char* reason) const {
    throw FormatError("invalid specification \"" + std::string(whole_) + "\": " + reason);
  }

  static bool is_one_of(char c, std::string_view set) {
    return set.find(c) != std::string_view::npos;
  }
  static bool is_digit(char c) { return c >= '0' && c <= '9'; }

private:
  std::string_view whole_;

  static char take(std::string_view& text) {
    const char c = text[0];
    text.remove_prefix(1);
    return c;
  }

  /// Takes the fill, one character of up to four bytes of UTF-8, and the alignment.
  void take_fill(std::string_view& text) {
    std::size_t length = text.empty() ? 0 : 1;
    while (length < text.size() && continues_character(text[length])) ++length;
    if (length > 0 && length < text.size() && is_one_of(text[length], "<>^")) {
      fill = text.substr(0, length);
      text.remove_prefix(length);
      align = take(text);
    } else if (!text.empty() && is_one_of(text[0], "<>^")) {
      align = take(text);
    }
  }

  int number(std::string_view& text) const {
    int value = 0;
    while (!text.empty() && is_digit(text[0])) {
      value = value * 10 + (take(text) - '0');
      if (value > 10'000) fail("expected a number up to 10000");
    }
    return value;
  }
};

}  // namespace conduit::detail::plain
