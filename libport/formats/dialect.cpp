#include "libport/formats/dialect.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <re2/re2.h>

#include "libport/base/whole_number.hpp"
#include "libport/formats/byte_text.hpp"
#include "libport/rules/toml_table.hpp"

namespace porttape {
namespace {

constexpr std::array<std::string_view, 5> kCodings{"hex", "decimal", "escaped", "text", "bracketed"};
constexpr std::array<std::string_view, 3> kLogUnits{"s", "ms", "us"};
constexpr std::array<std::string_view, 2> kDialectSides{"r", "w"};

std::optional<Bytes> hex_numbers(std::string_view text) {
  Bytes bytes;
  while (!text.empty()) {
    if (text.starts_with("0x") || text.starts_with("0X") || text.starts_with("\\x")) {
      text.remove_prefix(2);
      continue;
    }
    if (std::string_view(" ,:;-\t").find(text.front()) != std::string_view::npos) {
      text.remove_prefix(1);
      continue;
    }
    const auto high = hex_digit(text.front());
    const auto low = text.size() < 2 ? std::nullopt : hex_digit(text[1]);
    if (!high || !low) return std::nullopt;
    bytes.push_back(static_cast<Byte>(*high * 16 + *low));
    text.remove_prefix(2);
  }
  return bytes;
}

std::optional<Bytes> decimal_numbers(std::string_view text) {
  Bytes bytes;
  while (!text.empty()) {
    const std::size_t begin = std::min(text.find_first_not_of(" ,;\t[]"), text.size());
    text.remove_prefix(begin);
    if (text.empty()) break;
    const std::string_view number = text.substr(0, text.find_first_of(" ,;\t[]"));
    const auto value = whole_number<unsigned>(number);
    if (!value || *value > 0xff) return std::nullopt;
    bytes.push_back(static_cast<Byte>(*value));
    text.remove_prefix(number.size());
  }
  return bytes;
}

// Text in which a byte that cannot be shown is [0d].
std::optional<Bytes> bracketed_text(std::string_view text) {
  Bytes bytes;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto high = text.size() - i < 4 || text[i] != '[' ? std::nullopt : hex_digit(text[i + 1]);
    const auto low = high && text[i + 3] == ']' ? hex_digit(text[i + 2]) : std::nullopt;
    bytes.push_back(low ? static_cast<Byte>(*high * 16 + *low) : static_cast<Byte>(text[i]));
    i += low ? 3U : 0U;
  }
  return bytes;
}

}  // namespace

std::optional<Bytes> bytes_in(std::string_view text, Dialect::Coding coding) {
  std::size_t wrong_at = 0;
  switch (coding) {
    case Dialect::Coding::hex:
      return hex_numbers(text);
    case Dialect::Coding::decimal:
      return decimal_numbers(text);
    case Dialect::Coding::escaped:
      return unescaped_bytes(text, wrong_at);
    case Dialect::Coding::bracketed:
      return bracketed_text(text);
    case Dialect::Coding::text:
      return Bytes(text.begin(), text.end());
  }
  return std::nullopt;
}

std::string without_colors(std::string_view line) {
  std::string plain;
  plain.reserve(line.size());
  while (!line.empty()) {
    const char c = line.front();
    line.remove_prefix(1);
    if (c == '\x1b' && line.starts_with('[')) {
      const std::size_t end = line.find_first_not_of("0123456789;?", 1);
      line.remove_prefix(std::min(end == std::string_view::npos ? line.size() : end + 1, line.size()));
    } else if (c != '\r') {
      plain += c;
    }
  }
  return plain;
}

// Puts a dialect together out of its file.
class DialectReader {
 public:
  explicit DialectReader(std::string file) : file_(std::move(file)), problems_(file_) {}

  Result<Dialect> read(const std::string& text) {
    const toml::parse_result parsed = parse_toml(text, file_);
    if (!parsed) {
      return make_error(Errc::usage, fmt::format("{}:{}: {}", file_, parsed.error().source().begin.line,
                                                 parsed.error().description()));
    }
    TomlTable top(parsed.table(), "the dialect", problems_);
    for (const char* const name : {"name", "what"}) top.text(name);
    if (const auto unit = top.choice("unit", kLogUnits)) dialect_.unit_ = static_cast<LogUnit>(*unit);
    if (top.has("detect")) dialect_.detected_ = top.flag("detect");
    words(parsed.table(), top, "write", dialect_.writes_);
    words(parsed.table(), top, "read", dialect_.reads_);
    words(parsed.table(), top, "guess", dialect_.guesses_);
    std::vector<std::string> skips;
    words(parsed.table(), top, "skip", skips);
    for (const std::string& skip : skips) {
      if (auto expression = compiled(skip, top, "skip")) dialect_.skips_.push_back(std::move(expression));
    }
    lines(parsed.table(), top);
    top.no_others();
    if (problems_.any()) return problems_.error();
    return std::move(dialect_);
  }

 private:
  void words(const toml::table& table, TomlTable& top, std::string_view key, std::vector<std::string>& into) {
    top.asks(key);
    const toml::node* const node = table.get(key);
    if (node == nullptr) return;
    const toml::array* const list = node->as_array();
    if (list == nullptr) return top.wrong(key, "is no list of texts");
    for (const toml::node& each : *list) {
      const auto text = each.value<std::string>();
      if (!text) return top.wrong(key, "is no list of texts");
      into.push_back(*text);
    }
  }

  std::shared_ptr<const re2::RE2> compiled(std::string pattern, TomlTable& table, std::string_view key) {
    constexpr std::string_view kWord = "TIME";
    if (const std::size_t at = pattern.find(kWord); at != std::string::npos)
      pattern.replace(at, kWord.size(), kLogTimePattern);
    re2::RE2::Options options(re2::RE2::Latin1);
    options.set_log_errors(false);
    options.set_max_mem(std::int64_t{4} << 20U);
    auto expression = std::make_shared<const re2::RE2>(pattern, options);
    if (expression->ok()) return expression;
    table.wrong(key, "is no regular expression: " + expression->error());
    return nullptr;
  }

  void lines(const toml::table& table, TomlTable& top) {
    top.asks("line");
    const toml::node* const node = table.get("line");
    const toml::array* const list = node == nullptr ? nullptr : node->as_array();
    if (list == nullptr || list->empty()) return top.wrong("a [[line]] is missing, with its pattern");
    for (const toml::node& each : *list) {
      const toml::table* const one = each.as_table();
      if (one == nullptr) return top.wrong("line", "is no table: [[line]]");
      TomlTable line(*one, "[[line]]", problems_);
      take_line(line);
      line.no_others();
    }
  }

  void take_line(TomlTable& line) {
    const auto pattern = line.text("pattern");
    Dialect::Pattern made;
    if (const auto coding = line.choice("bytes", kCodings))
      made.coding = static_cast<Dialect::Coding>(*coding);
    if (const auto side = line.choice("direction", kDialectSides))
      made.direction = *side == 0 ? Direction::read : Direction::write;
    if (const auto end = line.text("end")) made.end.assign(end->begin(), end->end());
    constexpr std::int64_t kLongestRow = 65'536;
    made.row = static_cast<std::size_t>(line.integer("row", 1, kLongestRow).value_or(0));
    if (!pattern) return line.wrong("'pattern' is missing, a regular expression");
    made.expression = compiled(*pattern, line, "pattern");
    if (made.expression == nullptr) return;
    for (const auto& [name, group] : made.expression->NamedCapturingGroups()) {
      if (name == "bytes") made.bytes_group = group;
      if (name == "time") made.time_group = group;
      if (name == "direction") made.direction_group = group;
    }
    if (made.bytes_group == 0) return line.wrong("pattern", "has no group (?P<bytes>…)");
    if (made.direction_group == 0 && !made.direction)
      return line.wrong("pattern", "has no group (?P<direction>…), and there is no 'direction'");
    dialect_.patterns_.push_back(std::move(made));
  }

  std::string file_;
  Problems problems_;
  Dialect dialect_;
};

Result<Dialect> Dialect::parse(const std::string& toml, const std::string& file) {
  return DialectReader(file).read(toml);
}

std::optional<Direction> Dialect::direction_of(std::string_view word) const {
  if (std::ranges::find(writes_, word) != writes_.end()) return Direction::write;
  if (std::ranges::find(reads_, word) != reads_.end()) return Direction::read;
  return std::nullopt;
}

Dialect::Found Dialect::find(std::string_view line) const {
  const re2::StringPiece text(line.data(), line.size());
  for (const auto& skip : skips_) {
    if (re2::RE2::PartialMatch(text, *skip)) return {Found::What::nothing, {}, {}, {}, false};
  }
  bool damaged = false;
  for (const Pattern& pattern : patterns_) {
    std::vector<re2::StringPiece> groups(
        static_cast<std::size_t>(pattern.expression->NumberOfCapturingGroups()) + 1);
    if (!pattern.expression->Match(text, 0, line.size(), re2::RE2::UNANCHORED, groups.data(),
                                   static_cast<int>(groups.size())))
      continue;
    const auto group = [&](int number) {
      const re2::StringPiece& piece = groups[static_cast<std::size_t>(number)];
      return std::string_view(piece.data(), piece.size());
    };
    Found found{Found::What::bytes, pattern.direction, {}, {}, false};
    if (pattern.direction_group != 0) {
      if (const auto told = direction_of(group(pattern.direction_group))) found.direction = told;
    }
    auto bytes = bytes_in(group(pattern.bytes_group), pattern.coding);
    damaged |= !bytes || !found.direction;
    if (!bytes || !found.direction) continue;
    found.goes_on = pattern.row > 0 && bytes->size() >= pattern.row;
    append(*bytes, pattern.end);
    found.bytes = std::move(*bytes);
    if (pattern.time_group != 0 && !group(pattern.time_group).empty()) found.time = group(pattern.time_group);
    return found;
  }
  return {damaged ? Found::What::damaged : Found::What::unknown, {}, {}, {}, false};
}

}  // namespace porttape
