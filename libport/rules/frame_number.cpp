#include "libport/rules/frame_number.hpp"

#include <charconv>
#include <string_view>

namespace porttape {
namespace {

std::string_view without_spaces(ByteView field) {
  std::string_view text = as_text(field);
  while (text.starts_with(' ')) text.remove_prefix(1);
  while (text.ends_with(' ')) text.remove_suffix(1);
  return text;
}

template <class Number, class... Base>
std::optional<Number> whole_text(std::string_view text, Base... base) {
  Number number{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number, base...);
  if (error != std::errc() || stop != end) return std::nullopt;
  return number;
}

std::optional<std::uint64_t> binary(const Rule& rule, ByteView field) {
  if (field.empty() || field.size() > 8) return std::nullopt;
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < field.size(); ++i)
    value = value << 8 | field[rule.order == ByteOrder::big ? i : field.size() - 1 - i];
  return value;
}

// How many values `size` digits of that base have; 0: more than fit.
std::uint64_t values_of(std::uint64_t base, std::size_t size) {
  std::uint64_t values = 1;
  for (std::size_t i = 0; i < size; ++i) {
    if (values > ~std::uint64_t{0} / base) return 0;
    values *= base;
  }
  return values;
}

std::uint64_t modulo_of(const Rule& rule, std::size_t size) {
  if (rule.counter.modulo > 0) return rule.counter.modulo;
  if (rule.length) return 0;  // a number that may grow longer has no end
  if (rule.type == NumberType::decimal) return values_of(10, size);
  return values_of(rule.type == NumberType::hex ? 16 : 256, size);
}

}  // namespace

std::optional<std::uint64_t> whole_number_in(const Rule& rule, ByteView field) {
  if (rule.type == NumberType::decimal) return whole_text<std::uint64_t>(without_spaces(field), 10);
  if (rule.type == NumberType::hex) return whole_text<std::uint64_t>(without_spaces(field), 16);
  return binary(rule, field);
}

std::optional<double> real_number(const Rule& rule, ByteView field) {
  if (rule.type == NumberType::decimal) return whole_text<double>(without_spaces(field));
  const auto value = whole_number_in(rule, field);
  if (!value) return std::nullopt;
  if (rule.type != NumberType::signed_) return static_cast<double>(*value);
  const unsigned unused = 64 - static_cast<unsigned>(field.size()) * 8;
  return static_cast<double>(static_cast<std::int64_t>(*value << unused) >> unused);
}

// Also backwards: `more` wraps.
std::uint64_t counted_on(const Rule& rule, std::size_t size, std::uint64_t value, std::uint64_t more) {
  const std::uint64_t modulo = modulo_of(rule, size);
  if (modulo == 0) return value + more;
  const auto difference = static_cast<std::int64_t>(more);
  const std::uint64_t back = difference < 0 ? (0 - more) % modulo : 0;
  const std::uint64_t step = difference < 0 ? (modulo - back) % modulo : more % modulo;
  const std::uint64_t begin = value % modulo;
  return begin >= modulo - step ? begin - (modulo - step) : begin + step;
}

}  // namespace porttape
