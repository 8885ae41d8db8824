#include "libport/rules/toml_table.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <sstream>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/result.hpp"
#include "libport/rules/checksum.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostTold = 20;

// Where a string or a comment that begins at `at` ends; `at` where none begins. One that never ends, or not
// in its line, is wrong and ends there.
std::size_t end_of_text(std::string_view text, std::size_t at) {
  const char quote = text[at];
  if (quote == '#') return std::min(text.find('\n', at), text.size());
  if (quote != '"' && quote != '\'') return at;
  const std::string_view three = text.substr(at, 3);
  const bool long_one = three.size() == 3 && three[1] == quote && three[2] == quote;
  const std::string_view mark = long_one ? three : three.substr(0, 1);
  for (at += mark.size(); at < text.size(); ++at) {
    if (text[at] == '\\' && quote == '"') {
      ++at;
    } else if (text.substr(at, mark.size()) == mark) {
      return at + mark.size();
    } else if (text[at] == '\n' && !long_one) {
      return at;
    }
  }
  return text.size();
}

std::string kind_of(const toml::node& node) {
  std::ostringstream kind;
  kind << node.type();
  return kind.str();
}

}  // namespace

toml::parse_result parse_toml(std::string text, const std::string& file) {
  for (std::size_t at = text.starts_with("\xEF\xBB\xBF") ? 3 : 0; at != text.size();) {
    const std::size_t end = end_of_text(text, at);
    const bool quote = text[at] == '"' || text[at] == '\'';
    const bool inside =
        quote && at > 0 && std::string_view(" \t\r\n=,.[{\xBF").find(text[at - 1]) == std::string_view::npos;
    if (inside || (end == at && static_cast<unsigned char>(text[at]) >= 0x80)) {
      text[at] = '?';
      text.resize(at + 1);  // what follows is read no more
      break;
    }
    at = std::max(end, at + 1);
  }
  return toml::parse(text, std::string_view(file));
}

Error Problems::error() {
  std::stable_sort(problems_.begin(), problems_.end(),
                   [](const auto& one, const auto& other) { return one.first < other.first; });
  std::string all;
  for (std::size_t n = 0; n < std::min(problems_.size(), kMostTold); ++n) {
    all += fmt::format("{}{}:{}: {}", n == 0 ? "" : "\n", printable_line(file_), problems_[n].first,
                       printable_line(problems_[n].second));
  }
  if (problems_.size() > kMostTold)
    all += fmt::format("\nand {} more of the kind", problems_.size() - kMostTold);
  return make_error(Errc::usage, all);
}

std::size_t TomlTable::line_of(std::string_view key) const {
  const toml::node* node = table_.get(key);
  return node == nullptr ? line() : node->source().begin.line;
}

const toml::node* TomlTable::get(std::string_view key) {
  asked_.emplace(key);
  return table_.get(key);
}

void TomlTable::wrong(std::string_view key, std::string_view what) {
  problems_.tell(line_of(key), fmt::format("key '{}' of {} {}", key, name_, what));
}

void TomlTable::wrong(std::string_view what) { problems_.tell(line(), fmt::format("{} {}", name_, what)); }

void TomlTable::wrong_kind(std::string_view key, const toml::node& node, std::string_view accepted) {
  wrong(key, fmt::format("is of the kind {}; accepted: {}", kind_of(node), accepted));
}

std::optional<std::string> TomlTable::text(std::string_view key) {
  const toml::node* node = get(key);
  if (node == nullptr) return std::nullopt;
  if (const auto* value = node->as_string()) return value->get();
  wrong_kind(key, *node, "text in quotes");
  return std::nullopt;
}

std::optional<std::int64_t> TomlTable::integer(std::string_view key, std::int64_t least, std::int64_t most) {
  const toml::node* node = get(key);
  if (node == nullptr) return std::nullopt;
  const auto* value = node->as_integer();
  const std::string accepted = fmt::format("a whole number from {} to {}", least, most);
  if (value == nullptr) {
    wrong_kind(key, *node, accepted);
  } else if (value->get() < least || value->get() > most) {
    wrong(key, fmt::format("is {}; accepted: {}", value->get(), accepted));
  } else {
    return value->get();
  }
  return std::nullopt;
}

std::optional<double> TomlTable::number(std::string_view key, double least, double most) {
  const toml::node* node = get(key);
  if (node == nullptr) return std::nullopt;
  const std::string accepted = fmt::format("a number from {} to {}", least, most);
  const auto value = node->value<double>();
  if (!value || !node->is_number()) {
    wrong_kind(key, *node, accepted);
  } else if (!(*value >= least && *value <= most)) {
    wrong(key, fmt::format("is {}; accepted: {}", *value, accepted));
  } else {
    return *value;
  }
  return std::nullopt;
}

bool TomlTable::flag(std::string_view key) {
  const toml::node* node = get(key);
  if (node == nullptr) return false;
  if (const auto* value = node->as_boolean()) return value->get();
  wrong_kind(key, *node, "true, false");
  return false;
}

std::optional<std::size_t> TomlTable::choice(std::string_view key, std::span<const std::string_view> words) {
  const std::optional<std::string> word = text(key);
  if (!word) return std::nullopt;
  const auto found = std::find(words.begin(), words.end(), *word);
  if (found != words.end()) return static_cast<std::size_t>(found - words.begin());
  wrong(key, fmt::format("is {}; accepted: {}{}", in_quotes(*word), fmt::join(words, ", "),
                         did_you_mean(*word, words)));
  return std::nullopt;
}

std::optional<std::pair<double, double>> TomlTable::range(std::string_view key) {
  const toml::node* node = get(key);
  if (node == nullptr) return std::nullopt;
  const toml::array* list = node->as_array();
  const auto number_of = [&](std::size_t at) { return (*list)[at].value<double>(); };
  const bool two = list != nullptr && list->size() == 2 && (*list)[0].is_number() && (*list)[1].is_number();
  if (two && *number_of(0) <= *number_of(1)) return std::pair{*number_of(0), *number_of(1)};
  if (two) {
    wrong(key, fmt::format("is [{}, {}]; accepted: the smaller number first", *number_of(0), *number_of(1)));
  } else {
    wrong_kind(key, *node, "two numbers, [least, most]");
  }
  return std::nullopt;
}

std::optional<Bytes> TomlTable::hex(std::string_view key) {
  std::optional<std::string> digits = text(key);
  if (!digits) return std::nullopt;
  digits->erase(std::remove(digits->begin(), digits->end(), ' '), digits->end());
  auto bytes = bytes_of_hex(*digits);
  if (bytes && !bytes->empty()) return bytes;
  wrong(key, fmt::format("is {}; accepted: two hexadecimal digits for each byte", in_quotes(*digits)));
  return std::nullopt;
}

std::optional<Bytes> TomlTable::bytes(std::string_view key) {
  const std::string in_hex = fmt::format("{}_hex", key);
  asks(key);
  if (auto found = hex(in_hex)) {
    if (has(key)) wrong(key, fmt::format("is there besides '{}'; accepted: one of them", in_hex));
    return found;
  }
  const std::optional<std::string> plain = text(key);
  if (!plain) return std::nullopt;
  return Bytes(plain->begin(), plain->end());
}

std::optional<TomlTable> TomlTable::table(std::string_view key) {
  const toml::node* node = get(key);
  if (node == nullptr) return std::nullopt;
  if (const toml::table* found = node->as_table())
    return TomlTable(*found, fmt::format("'{}' of {}", key, name_), problems_);
  wrong_kind(key, *node, "a table, { … }");
  return std::nullopt;
}

void TomlTable::no_others() {
  const std::vector<std::string_view> known(asked_.begin(), asked_.end());
  for (const auto& [key, node] : table_) {
    if (asked_.contains(key.str())) continue;
    problems_.tell(key.source().begin.line, fmt::format("{} has no key {}{}", name_, in_quotes(key.str()),
                                                        did_you_mean(key.str(), known)));
  }
}

}  // namespace porttape
