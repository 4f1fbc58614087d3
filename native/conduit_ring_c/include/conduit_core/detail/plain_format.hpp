/// @file
/// The subset of std::format for log lines, used without <format> and {fmt}: `{}`, `{0}` and
/// `{:[[fill]<|>|^][+|-| ][#][0][width][.precision][type]}`. Anything else throws a FormatError
/// that names it.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

#include "format_spec.hpp"

namespace conduit::detail::plain {

/// Returns the number of UTF-8 characters.
inline std::size_t characters(std::string_view text) {
  std::size_t count = 0;
  for (const char c : text) count += continues_character(c) ? 0 : 1;
  return count;
}

/// Pads a text to the width. `usual` is the alignment when the specification has none.
inline std::string aligned(std::string text, const Spec& spec, char usual) {
  const std::size_t length = characters(text);
  if (length >= spec.width) return text;
  const std::size_t missing = spec.width - length;
  const char align = spec.align == '\0' ? usual : spec.align;
  const std::size_t before = align == '<' ? 0 : align == '>' ? missing : missing / 2;
  std::string padded;
  for (std::size_t i = 0; i < before; ++i) padded += spec.fill;
  padded += text;
  for (std::size_t i = before; i < missing; ++i) padded += spec.fill;
  return padded;
}

/// The parts of a number: sign, base prefix and digits.
struct Numeral {
  bool negative;
  std::string prefix;
  std::string digits;
  /// False for infinity and NaN, which get no leading zeros.
  bool finite = true;
};

/// Joins the parts of a number, with zeros before the digits if the specification asks for them.
inline std::string put_numeral(Numeral number, const Spec& spec) {
  std::string prefix = std::move(number.prefix);
  if (number.negative) prefix.insert(0, 1, '-');
  else if (spec.sign != '-') prefix.insert(0, 1, spec.sign);
  const std::size_t length = prefix.size() + number.digits.size();
  const bool zeros = spec.zero && number.finite && spec.align == '\0';
  if (zeros && length < spec.width) prefix.append(spec.width - length, '0');
  return aligned(prefix + number.digits, spec, '>');
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
    spec.fail("expected a number, got: a text");
  if (spec.precision >= 0) {
    std::size_t end = 0;
    for (int taken = 0; end < text.size(); ++end) {
      if (!continues_character(text[end]) && taken++ == spec.precision) break;
    }
    text = text.substr(0, end);
  }
  return aligned(std::string(text), spec, '<');
}

inline std::string put_integer(const Argument& argument, const Spec& spec) {
  if (spec.precision >= 0) spec.fail("an integer has no precision");
  const auto put = [&](const char* prefix, unsigned base, bool upper) {
    const bool prefixed = spec.alternate && !(base == 8 && argument.magnitude == 0);
    std::string digits = based(argument.magnitude, base, upper);
    return put_numeral({argument.negative, prefixed ? prefix : "", std::move(digits)}, spec);
  };
  switch (spec.type) {
    case '\0':
    case 'd': return put("", 10, false);
    case 'x': return put("0x", 16, false);
    case 'X': return put("0X", 16, true);
    case 'b': return put("0b", 2, false);
    case 'B': return put("0B", 2, false);
    case 'o': return put("0", 8, false);
    case 'c': {
      if (argument.negative || argument.magnitude > 127) spec.fail("expected a character");
      const auto character = static_cast<char>(argument.magnitude);
      return put_text(std::string(1, character), Spec(std::string_view()));
    }
    default: spec.fail("not supported for an integer");
  }
}

inline std::string printed(long double value, int precision, char type, bool alternate) {
  const std::string directive = std::string("%") + (alternate ? "#" : "") + ".*L" + type;
  std::string text(64, '\0');
  for (;;) {
    const int length =
        std::snprintf(text.data(), text.size(), directive.c_str(), precision, value);
    if (length < 0) throw FormatError("could not print a number");
    const auto size = static_cast<std::size_t>(length);
    const bool fits = size < text.size();
    text.resize(fits ? size : size + 1);
    if (fits) return text;
  }
}

inline long double read_back(const std::string& text, int digits) {
  if (digits == 9) return static_cast<long double>(std::strtof(text.c_str(), nullptr));
  if (digits == 17) return static_cast<long double>(std::strtod(text.c_str(), nullptr));
  return std::strtold(text.c_str(), nullptr);
}

/// Returns the fewest digits that read back as the same value of its type, in the shorter
/// notation.
inline std::string shortest(long double value, int digits, bool alternate) {
  const auto is_exact = [&](int decimals) {
    return read_back(printed(value, decimals, 'e', false), digits) == value;
  };
  int behind_point = 0;
  while (behind_point < digits - 1 && !is_exact(behind_point)) ++behind_point;
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
    return put_numeral({negative, "", word, false}, spec);
  }
  const auto put = [&](std::string digits) {
    return put_numeral({negative, "", std::move(digits)}, spec);
  };
  switch (spec.type) {
    case '\0':
      if (spec.precision < 0) return put(shortest(value, argument.digits, spec.alternate));
      return put(printed(value, spec.precision, 'g', spec.alternate));
    case 'e':
    case 'E':
    case 'f':
    case 'F':
    case 'g':
    case 'G': {
      const int precision = spec.precision < 0 ? 6 : spec.precision;
      return put(printed(value, precision, spec.type, spec.alternate));
    }
    default: spec.fail("not supported for a floating-point number");
  }
}

inline std::string put_boolean(const Argument& argument, const Spec& spec) {
  const bool as_text = spec.type == '\0' || spec.type == 's';
  if (!as_text) return put_integer(argument, spec);
  return put_text(argument.magnitude == 1 ? "true" : "false", spec);
}

inline std::string put_character(const Argument& argument, const Spec& spec) {
  if (spec.type != '\0' && spec.type != 'c') return put_integer(argument, spec);
  const std::uint64_t code = argument.negative ? 0 - argument.magnitude : argument.magnitude;
  const auto character = static_cast<char>(code);
  Spec without_type = spec;
  without_type.type = '\0';
  return put_text(std::string_view(&character, 1), without_type);
}

inline std::string put_pointer(const Argument& argument, const Spec& spec) {
  if (spec.type != '\0' && spec.type != 'p') spec.fail("not supported for a pointer");
  return aligned("0x" + based(argument.magnitude, 16, false), spec, '>');
}

inline std::string put(const Argument& argument, const Spec& spec) {
  using Kind = Argument::Kind;
  switch (argument.kind) {
    case Kind::text: return put_text(argument.text, spec);
    case Kind::real: return put_real(argument, spec);
    case Kind::boolean: return put_boolean(argument, spec);
    case Kind::character: return put_character(argument, spec);
    case Kind::pointer: return put_pointer(argument, spec);
    default: return put_integer(argument, spec);
  }
}

/// Formats a text with its arguments.
class Formatter {
public:
  Formatter(std::string_view text, std::initializer_list<Argument> arguments)
      : text_(text), arguments_(arguments) {}

  std::string run() {
    while (!text_.empty()) {
      const char c = text_[0];
      const bool twice = text_.size() > 1 && text_[1] == c;
      if (c != '{' && c != '}') copy(1);
      else if (twice) copy(2);
      else if (c == '}') throw FormatError("unmatched \"}\"; write \"}}\" for a brace");
      else replace_field();
    }
    return std::move(written_);
  }

private:
  enum class Numbering { unknown, automatic, manual };

  void copy(std::size_t length) {
    written_ += text_[0];
    text_.remove_prefix(length);
  }

  void replace_field() {
    const std::size_t end = text_.find('}');
    if (end == std::string_view::npos)
      throw FormatError("unmatched \"{\"; write \"{{\" for a brace");
    const std::string_view field = text_.substr(1, end - 1);
    const std::size_t colon = field.find(':');
    const Argument& argument = pick(field.substr(0, colon));
    const bool specified = colon != std::string_view::npos;
    written_ += put(argument, Spec(specified ? field.substr(colon + 1) : std::string_view()));
    text_.remove_prefix(end + 1);
  }

  const Argument& pick(std::string_view index) {
    const Numbering wanted = index.empty() ? Numbering::automatic : Numbering::manual;
    if (numbering_ != Numbering::unknown && numbering_ != wanted)
      throw FormatError("cannot mix \"{}\" and \"{0}\"");
    numbering_ = wanted;
    const std::size_t number = index.empty() ? next_++ : read(index);
    if (number >= arguments_.size())
      throw FormatError("expected an argument " + std::to_string(number) + ", got: " +
                        std::to_string(arguments_.size()) + " arguments");
    return arguments_.begin()[number];
  }

  static std::size_t read(std::string_view index) {
    std::size_t value = 0;
    for (const char c : index) {
      if (!Spec::is_digit(c) || value > 1'000)
        throw FormatError("expected an argument number, got: {" + std::string(index) + "}");
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
