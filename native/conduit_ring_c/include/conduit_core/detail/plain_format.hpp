/// The part of std::format that log lines need where neither <format> nor {fmt} is there: `{}`, `{0}`, and
/// `{:[[fill]<|>|^][+|-| ][#][0][width][.precision][type]}`. Anything else is refused with a FormatError that names it.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace conduit::detail::plain {

/// What is wrong with a text, or not known here.
class FormatError : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

template <class T>
inline constexpr bool is_formattable =
    std::is_arithmetic_v<T> || std::is_same_v<T, std::string> || std::is_same_v<T, std::string_view> ||
    std::is_same_v<T, const void*> || std::is_same_v<T, void*>;

/// One argument, whatever its type.
struct Argument {
  enum class Kind { boolean, character, integer, real, text, pointer };

  Kind kind = Kind::integer;
  bool negative = false;
  std::uint64_t magnitude = 0;
  long double real = 0;
  /// Significant digits that tell every value of the real's type apart: the shortest text is found below it.
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

/// What stands behind the colon.
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
      if (text.empty() || !is_digit(text[0])) refuse("has no digits behind its point");
      precision = number(text);
    }
    if (!text.empty() && is_one_of(text[0], "bBcdoxXaAeEfFgGsp")) type = take(text);
    if (!text.empty()) refuse("is not known here");
  }

  [[noreturn]] void refuse(const char* why) const {
    throw FormatError("the specification \"" + std::string(whole_) + "\" " + why);
  }

  static bool is_one_of(char c, std::string_view set) { return set.find(c) != std::string_view::npos; }
  static bool is_digit(char c) { return c >= '0' && c <= '9'; }

private:
  std::string_view whole_;

  static char take(std::string_view& text) {
    const char c = text[0];
    text.remove_prefix(1);
    return c;
  }

  /// The fill is one character, which UTF-8 writes with up to four bytes.
  void take_fill(std::string_view& text) {
    std::size_t length = text.empty() ? 0 : 1;
    while (length < text.size() && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) ++length;
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
      if (value > 10'000) refuse("has a number above 10000");
    }
    return value;
  }
};

/// Characters of UTF-8.
inline std::size_t characters(std::string_view text) {
  std::size_t count = 0;
  for (const char c : text) count += (static_cast<unsigned char>(c) & 0xC0U) != 0x80U ? 1 : 0;
  return count;
}

/// Fills up to the width; `usual` is where the text stands when nothing is said.
inline std::string aligned(std::string text, const Spec& spec, char usual) {
  const std::size_t length = characters(text);
  if (length >= spec.width) return text;
  const std::size_t missing = spec.width - length;
  const char align = spec.align == '\0' ? usual : spec.align;
  const std::size_t before = align == '<' ? 0 : align == '>' ? missing : missing / 2;
  std::string filled;
  for (std::size_t i = 0; i < before; ++i) filled += spec.fill;
  filled += text;
  for (std::size_t i = before; i < missing; ++i) filled += spec.fill;
  return filled;
}

/// A number of its parts: sign, base and digits, between which zeros may stand.
inline std::string numeral(bool negative, std::string prefix, const std::string& digits, const Spec& spec, bool finite) {
  if (negative) prefix.insert(0, 1, '-');
  else if (spec.sign != '-') prefix.insert(0, 1, spec.sign);
  const std::size_t length = prefix.size() + digits.size();
  if (spec.zero && finite && spec.align == '\0' && length < spec.width) prefix.append(spec.width - length, '0');
  return aligned(prefix + digits, spec, '>');
}

inline std::string based(std::uint64_t value, unsigned base, bool upper) {
  const char* const digits = upper ? "0123456789ABCDEF" : "0123456789abcdef";
  std::string text;
  do {
    text.insert(0, 1, digits[value % base]);
    value /= base;
  } while (value != 0);
  return text;
}

inline std::string put_text(std::string_view text, const Spec& spec) {
  if ((spec.type != '\0' && spec.type != 's') || spec.sign != '-' || spec.alternate || spec.zero)
    spec.refuse("is for a number, and the argument is a text");
  if (spec.precision >= 0) {
    std::size_t end = 0;
    for (int taken = 0; end < text.size(); ++end) {
      const bool begins = (static_cast<unsigned char>(text[end]) & 0xC0U) != 0x80U;
      if (begins && taken++ == spec.precision) break;
    }
    text = text.substr(0, end);
  }
  return aligned(std::string(text), spec, '<');
}

inline std::string put_integer(const Argument& argument, const Spec& spec) {
  if (spec.precision >= 0) spec.refuse("has a precision, and the argument is an integer");
  switch (spec.type) {
    case '\0':
    case 'd': return numeral(argument.negative, "", based(argument.magnitude, 10, false), spec, true);
    case 'x': return numeral(argument.negative, spec.alternate ? "0x" : "", based(argument.magnitude, 16, false), spec, true);
    case 'X': return numeral(argument.negative, spec.alternate ? "0X" : "", based(argument.magnitude, 16, true), spec, true);
    case 'b': return numeral(argument.negative, spec.alternate ? "0b" : "", based(argument.magnitude, 2, false), spec, true);
    case 'B': return numeral(argument.negative, spec.alternate ? "0B" : "", based(argument.magnitude, 2, false), spec, true);
    case 'o':
      return numeral(argument.negative, spec.alternate && argument.magnitude != 0 ? "0" : "",
                     based(argument.magnitude, 8, false), spec, true);
    case 'c':
      if (argument.negative || argument.magnitude > 127) spec.refuse("is for a character, and the argument is none");
      return put_text(std::string(1, static_cast<char>(argument.magnitude)), Spec(std::string_view()));
    default: spec.refuse("is not for an integer");
  }
}

inline std::string printed(long double value, int precision, char type, bool alternate) {
  const std::string directive = std::string("%") + (alternate ? "#" : "") + ".*L" + type;
  std::string text(64, '\0');
  for (;;) {
    const int length = std::snprintf(text.data(), text.size(), directive.c_str(), precision, value);
    if (length < 0) throw FormatError("a number could not be printed");
    const bool fits = static_cast<std::size_t>(length) < text.size();
    text.resize(fits ? static_cast<std::size_t>(length) : static_cast<std::size_t>(length) + 1);
    if (fits) return text;
  }
}

inline long double read_back(const std::string& text, int digits) {
  if (digits == 9) return static_cast<long double>(std::strtof(text.c_str(), nullptr));
  if (digits == 17) return static_cast<long double>(std::strtod(text.c_str(), nullptr));
  return std::strtold(text.c_str(), nullptr);
}

/// The least digits that are read back as the same value of its type, in the shorter notation.
inline std::string shortest(long double value, int digits, bool alternate) {
  int behind_point = 0;
  while (behind_point < digits - 1 && read_back(printed(value, behind_point, 'e', false), digits) != value) ++behind_point;
  const std::string scientific = printed(value, behind_point, 'e', alternate);
  const int exponent = std::atoi(scientific.c_str() + scientific.find('e') + 1);
  if (exponent > digits + 4) return scientific;
  const int decimals = behind_point > exponent ? behind_point - exponent : 0;
  std::string fixed = printed(value, decimals, 'f', alternate);
  return fixed.size() <= scientific.size() ? fixed : scientific;
}

inline std::string put_real(const Argument& argument, const Spec& spec) {
  const bool negative = std::signbit(argument.real);
  const long double value = negative ? -argument.real : argument.real;
  const bool upper = Spec::is_one_of(spec.type, "EFGA") && spec.type != '\0';
  if (!(value - value == 0)) {
    const char* const word = value != value ? (upper ? "NAN" : "nan") : (upper ? "INF" : "inf");
    return numeral(negative, "", word, spec, false);
  }
  switch (spec.type) {
    case '\0':
      return numeral(negative, "",
                     spec.precision < 0 ? shortest(value, argument.digits, spec.alternate)
                                        : printed(value, spec.precision, 'g', spec.alternate),
                     spec, true);
    case 'e':
    case 'E':
    case 'f':
    case 'F':
    case 'g':
    case 'G':
      return numeral(negative, "", printed(value, spec.precision < 0 ? 6 : spec.precision, spec.type, spec.alternate),
                     spec, true);
    default: spec.refuse("is not for a floating-point number");
  }
}

inline std::string put(const Argument& argument, const Spec& spec) {
  using Kind = Argument::Kind;
  const bool as_text = spec.type == '\0' || spec.type == 's';
  switch (argument.kind) {
    case Kind::text: return put_text(argument.text, spec);
    case Kind::real: return put_real(argument, spec);
    case Kind::boolean: return as_text ? put_text(argument.magnitude == 1 ? "true" : "false", spec) : put_integer(argument, spec);
    case Kind::character: {
      if (spec.type != '\0' && spec.type != 'c') return put_integer(argument, spec);
      const auto value = static_cast<char>(argument.negative ? 0 - argument.magnitude : argument.magnitude);
      Spec plain = spec;
      plain.type = '\0';
      return put_text(std::string_view(&value, 1), plain);
    }
    case Kind::pointer: {
      if (spec.type != '\0' && spec.type != 'p') spec.refuse("is not for a pointer");
      return aligned("0x" + based(argument.magnitude, 16, false), spec, '>');
    }
    default: return put_integer(argument, spec);
  }
}

/// Goes through a text and puts the arguments where they belong.
class Formatter {
public:
  Formatter(std::string_view text, std::initializer_list<Argument> arguments) : text_(text), arguments_(arguments) {}

  std::string run() {
    while (!text_.empty()) {
      const char c = text_[0];
      const bool twice = text_.size() > 1 && text_[1] == c;
      if (c != '{' && c != '}') copy(1);
      else if (twice) copy(2);
      else if (c == '}') throw FormatError("a \"}\" stands alone; \"}}\" writes one");
      else place();
    }
    return std::move(written_);
  }

private:
  enum class Numbering { unknown, automatic, manual };

  void copy(std::size_t length) {
    written_ += text_[0];
    text_.remove_prefix(length);
  }

  void place() {
    const std::size_t end = text_.find('}');
    if (end == std::string_view::npos) throw FormatError("a \"{\" has no end; \"{{\" writes one");
    const std::string_view inside = text_.substr(1, end - 1);
    const std::size_t colon = inside.find(':');
    const Argument& argument = pick(inside.substr(0, colon));
    const std::string_view spec = colon == std::string_view::npos ? std::string_view() : inside.substr(colon + 1);
    written_ += put(argument, Spec(spec));
    text_.remove_prefix(end + 1);
  }

  const Argument& pick(std::string_view index) {
    const Numbering wanted = index.empty() ? Numbering::automatic : Numbering::manual;
    if (numbering_ != Numbering::unknown && numbering_ != wanted) throw FormatError("\"{}\" and \"{0}\" are mixed");
    numbering_ = wanted;
    const std::size_t number = index.empty() ? next_++ : read(index);
    if (number >= arguments_.size())
      throw FormatError("argument " + std::to_string(number) + " is wanted, and there are " + std::to_string(arguments_.size()));
    return arguments_.begin()[number];
  }

  static std::size_t read(std::string_view index) {
    std::size_t value = 0;
    for (const char c : index) {
      if (!Spec::is_digit(c) || value > 1'000) throw FormatError("\"{" + std::string(index) + "}\" names no argument");
      value = value * 10 + static_cast<std::size_t>(c - '0');
    }
    return value;
  }

  std::string_view text_;
  std::initializer_list<Argument> arguments_;
  std::string written_;
  std::size_t next_ = 0;
  Numbering numbering_ = Numbering::unknown;
};

inline std::string vformat(std::string_view text, std::initializer_list<Argument> arguments) {
  return Formatter(text, arguments).run();
}

}  // namespace conduit::detail::plain
