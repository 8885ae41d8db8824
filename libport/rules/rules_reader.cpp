#include "libport/rules/rules_reader.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <initializer_list>
#include <re2/re2.h>
#include <tuple>
#include <utility>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/rules/checksum.hpp"
#include "libport/rules/frame_place.hpp"
#include "libport/rules/framing.hpp"
#include "libport/rules/toml_table.hpp"

namespace porttape {
namespace {

constexpr std::int64_t kMostPosition = 65535;
constexpr std::size_t kMostLength = 65536;
// Bytes of what a frame begins or ends with: no protocol's has more than some 70 (a boundary of MIME).
constexpr std::size_t kMostMark = 256;
// Of each kind: [[frame]], [[rule]], [[reply]], [[redact]].
constexpr std::size_t kMostTables = 1000;
// Of an expression, as RE2 compiles it, and of all in a file.
constexpr int kMostStepsOfOne = 2100;  // RE2 repeats a thousand times at most, two steps each
constexpr int kMostSteps = 20'000;
constexpr std::array<std::string_view, 2> kOrders = {"big", "little"};
constexpr std::array<std::string_view, 4> kTypes = {"unsigned", "signed", "decimal", "hex"};
constexpr std::array<std::string_view, 4> kFrameKinds = {"delimited", "length", "fixed", "idle"};
constexpr std::array<std::string_view, 2> kDirections = {"r", "w"};
constexpr std::array<std::string_view, 5> kFillers = {"like", "digits", "letters", "hex", "bytes"};

class RulesReader {
 public:
  explicit RulesReader(const std::string& file) : problems_(file) { rules_.file = file; }

  Result<RuleSet> read(std::string_view text) {
    const toml::parse_result parsed = parse_toml(std::string(text), rules_.file);
    if (!parsed) {
      problems_.tell(parsed.error().source().begin.line,
                     fmt::format("this is no TOML: {}", parsed.error().description()));
      return problems_.error();
    }
    TomlTable file(parsed.table(), "the file", problems_);
    read_head(file);
    each(parsed.table(), "frame", [this](TomlTable& table) { read_frame(table); });
    each(parsed.table(), "rule", [this](TomlTable& table) { read_rule(table); });
    each(parsed.table(), "reply", [this](TomlTable& table) { read_reply(table); });
    each(parsed.table(), "redact", [this](TomlTable& table) { read_redaction(table); });
    file.no_others();
    if (!problems_.any() && rules_.rules.empty() && rules_.replies.empty() && rules_.redactions.empty())
      file.wrong("has neither a [[rule]] nor a [[reply]] nor a [[redact]]: nothing may vary");
    if (problems_.any()) return problems_.error();
    return std::move(rules_);
  }

 private:
  void read_head(TomlTable& file) {
    const auto format = file.text("format");
    if (format && *format != "porttape-rules")
      file.wrong("format", fmt::format("is {}; accepted: 'porttape-rules'", in_quotes(*format)));
    file.integer("version", 1, 1);
    for (const char* const key : {"frame", "rule", "reply", "redact"}) file.asks(key);
  }

  template <class Read>
  void each(const toml::table& file, std::string_view key, const Read& read) {
    const toml::node* node = file.get(key);
    if (node == nullptr) return;
    const toml::array* list = node->as_array();
    if (list == nullptr || !list->is_homogeneous(toml::node_type::table)) {
      problems_.tell(node->source().begin.line,
                     fmt::format("'{}' is no list of tables; accepted: [[{}]]", key, key));
      return;
    }
    if (list->size() > kMostTables)
      return problems_.tell(
          list->source().begin.line,
          fmt::format("there are {} of [[{}]]; accepted: {} at most", list->size(), key, kMostTables));
    for (const toml::node& item : *list) {
      TomlTable table(*item.as_table(), fmt::format("[[{}]]", key), problems_);
      if (const auto name = table.text("name"))
        table.set_name(fmt::format("[[{}]] {}", key, in_quotes(*name)));
      read(table);
      table.no_others();
    }
  }

  static RuleLine line_of(const TomlTable& table) { return {static_cast<int>(table.line())}; }

  void read_frame(TomlTable& table) {
    FrameFormat format;
    format.name = table.text("name").value_or("");
    format.line = line_of(table);
    if (const auto longest = table.integer("longest", 1, kMostLength))
      format.longest = static_cast<std::size_t>(*longest);
    const bool by_protocol = table.has("protocol");
    if (format.name.empty()) format.name = by_protocol ? table.text("protocol").value_or("") : "";
    if (!rules_.frames.empty() && known_frame(format.name.raw()))
      return table.wrong("name", fmt::format("is {}, as of an earlier one; accepted: a name of its own",
                                             format.name.in_quotes()));
    if (by_protocol) return read_protocol(table, std::move(format));
    if (format.name.empty()) table.wrong("lacks 'name': a name of its own");
    read_own_format(table, format);
    rules_.frames.push_back(std::move(format));
  }

  void read_protocol(TomlTable& table, const FrameFormat& own) {
    const auto protocol = table.choice("protocol", protocol_names());
    if (!protocol) return;
    for (FrameFormat& format : protocol_formats(protocol_names()[*protocol])) {
      format.name = own.name;
      format.line = own.line;
      if (table.has("longest")) format.longest = own.longest;
      rules_.frames.push_back(std::move(format));
    }
  }

  void read_own_format(TomlTable& table, FrameFormat& format) {
    format.start = mark(table, "start");
    const auto kind = table.choice("kind", kFrameKinds);
    if (!table.has("kind"))
      table.wrong(fmt::format("has neither 'kind' nor 'protocol'; accepted: kind: {}; protocol: {}",
                              fmt::join(kFrameKinds, ", "), fmt::join(protocol_names(), ", ")));
    if (!kind) return skip_kind(table);
    format.kind = static_cast<FrameFormat::Kind>(*kind);
    read_kind(table, format);
    refuse_impossible(table, format);
    if (auto checksum = table.table("checksum")) format.checksum = read_checksum(*checksum);
  }

  // What a frame begins or ends with.
  static Bytes mark(TomlTable& table, std::string_view key) {
    Bytes bytes = table.bytes(key).value_or(Bytes());
    if (bytes.size() > kMostMark) {
      table.wrong(table.has(key) ? std::string(key) : std::string(key) + "_hex",
                  fmt::format("has {} bytes; accepted: {} at most", bytes.size(), kMostMark));
      bytes.clear();
      bytes.push_back(0);
    }
    return bytes;
  }

  // A frame that is never found would leave its rules without an effect, and without a word.
  static void refuse_impossible(TomlTable& table, const FrameFormat& format) {
    const bool delimited = format.kind == FrameFormat::Kind::delimited;
    const bool fixed = format.kind == FrameFormat::Kind::fixed;
    const std::size_t least = format.start.size() + (delimited ? format.end.size() + format.trailer : 0);
    const std::size_t most = fixed ? format.size : format.longest;
    if (most > 0 && least > most)
      table.wrong(fmt::format(
          "has {} bytes at least, by its {}, and {} at most, by '{}': there is no such frame", least,
          delimited ? "'start', 'end' and 'trailer'" : "'start'", most, fixed ? "size" : "longest"));
  }

  // Keys of a frame whose kind is wrong are not to be told of.
  static void skip_kind(TomlTable& table) {
    for (const char* const key : {"end", "end_hex", "trailer", "length", "size", "idle_ms", "checksum"})
      table.asks(key);
  }

  void read_kind(TomlTable& table, FrameFormat& format) {
    using Kind = FrameFormat::Kind;
    if (format.kind == Kind::delimited) {
      format.end = mark(table, "end");
      if (format.end.empty())
        table.wrong("is delimited and has no 'end' (or 'end_hex'): what its frames end with");
      format.trailer = static_cast<std::size_t>(table.integer("trailer", 0, 64).value_or(0));
    } else if (format.kind == Kind::length) {
      auto length = table.table("length");
      if (!table.has("length")) table.wrong("has no 'length'; accepted: { at = …, size = …, adds = … }");
      if (length) read_length(*length, format.length);
    } else if (format.kind == Kind::fixed) {
      format.size = static_cast<std::size_t>(table.integer("size", 1, kMostLength).value_or(0));
      if (!table.has("size")) table.wrong("is fixed and has no 'size': bytes of each frame");
      format.longest = std::max(format.longest, format.size);
    } else {
      const auto idle = table.number("idle_ms", 0.001, 60'000);
      if (!table.has("idle_ms")) table.wrong("is idle and has no 'idle_ms': the pause that ends a frame");
      format.idle = Micros(std::llround(idle.value_or(1) * 1e3));
    }
  }

  void read_length(TomlTable& table, LengthField& length) {
    length.at = table.integer("at", 0, 1024).value_or(0);
    if (!table.has("at")) table.wrong("has no 'at': where the number stands in the frame");
    length.size = table.integer("size", 1, 4).value_or(1);
    length.order = order_of(table);
    length.adds = table.integer("adds", -kMostPosition, kMostPosition).value_or(0);
    length.signed_at = table.integer("signed_at", 0, 1024);
    table.no_others();
  }

  static ByteOrder order_of(TomlTable& table) {
    return table.choice("order", kOrders).value_or(0) == 0 ? ByteOrder::big : ByteOrder::little;
  }

  std::optional<ChecksumField> read_checksum(TomlTable& table) {
    ChecksumField field;
    const auto kind = table.text("kind");
    if (!table.has("kind")) table.wrong("has no 'kind': 'CRC-16/MODBUS', 'XOR', …");
    const ChecksumKind* known = kind ? find_checksum(*kind) : nullptr;
    if (kind && known == nullptr) {
      std::vector<std::string_view> names;
      for (const ChecksumKind& each : checksum_kinds()) names.push_back(each.name);
      table.wrong("kind", fmt::format("is {}, which is no known checksum; RULES.md lists them{}",
                                      in_quotes(*kind), did_you_mean(*kind, names)));
    }
    if (known != nullptr) field.kind = known->name;
    field.hex = table.flag("hex");
    field.of_hex = table.flag("of_hex");
    field.mavlink_extra = table.flag("mavlink_extra");
    field.order = order_of(table);
    const auto behind = known == nullptr ? 1 : static_cast<std::int64_t>(size_of(field, *known));
    field.at = table.integer("at", -kMostPosition, kMostPosition).value_or(-behind);
    field.from = table.integer("from", -kMostPosition, kMostPosition).value_or(0);
    field.to = table.integer("to", -kMostPosition, kMostPosition);
    if (known != nullptr && field.at < 0 && -field.at < behind)
      table.wrong("at", fmt::format("is {}, and the checksum is of {} bytes; accepted: {} or before",
                                    field.at, behind, -behind));
    table.no_others();
    return field;
  }

  [[nodiscard]] bool known_frame(const std::string& name) const {
    return std::any_of(rules_.frames.begin(), rules_.frames.end(),
                       [&](const FrameFormat& format) { return format.name == name; });
  }

  std::string read_frame_name(TomlTable& table, std::string_view key) {
    const auto name = table.text(key);
    if (!name || known_frame(*name)) return name.value_or("");
    std::vector<std::string_view> names;
    for (const FrameFormat& format : rules_.frames) names.push_back(format.name.raw());
    table.wrong(key, fmt::format("is {}, and there is no [[frame]] of that name{}", in_quotes(*name),
                                 did_you_mean(*name, names)));
    return {};
  }

  // `groups`: what it must have.
  std::string read_expression(TomlTable& table, std::string_view key, int groups = 0) {
    const auto text = table.text(key);
    if (!text) return {};
    const re2::RE2 expression(as_piece(as_bytes(*text)), rule_expression_options());
    if (!expression.ok()) {
      table.wrong(key, fmt::format("is no regular expression: {} (syntax: RE2's)", expression.error()));
    } else if (expression.NumberOfCapturingGroups() < groups) {
      table.wrong(key, "has no group in parentheses: what it captures is the place");
    } else {
      count_steps(table, key, expression.ProgramSize());
    }
    return *text;
  }

  // An expression takes up to some 10 ns a step for each byte that it is searched in.
  void count_steps(TomlTable& table, std::string_view key, int steps) {
    const bool told = steps_ > kMostSteps;
    steps_ += steps;
    if (steps > kMostStepsOfOne) {
      table.wrong(key, fmt::format("has {} steps; accepted: {} at most ('.{{0,100}}' has 200 of them)", steps,
                                   kMostStepsOfOne));
    } else if (steps_ > kMostSteps && !told) {
      table.wrong(key, fmt::format("brings the file's expressions to {} steps; accepted: {} at most", steps_,
                                   kMostSteps));
    }
  }

  void read_rule(TomlTable& table) {
    Rule rule;
    rule.name = table.text("name").value_or("");
    if (rule.name.empty()) table.wrong("lacks 'name': a name of its own");
    const bool twice = std::any_of(rules_.rules.begin(), rules_.rules.end(),
                                   [&](const Rule& other) { return other.name == rule.name; });
    if (twice && !rule.name.empty())
      table.wrong("name", "is that of an earlier rule; accepted: one of its own");
    rule.line = line_of(table);
    rule.frame = read_frame_name(table, "frame");
    rule.when = read_expression(table, "when");
    rule.optional = table.flag("optional");
    rule.repeated = table.flag("repeated");
    if (table.has("with_answer")) {
      rule.with_answer = table.flag("with_answer");
      if (!rule.optional)
        table.wrong("with_answer", "is of what may be left out; accepted: with optional = true");
    }
    read_variation(table, rule);
    rules_.rules.push_back(std::move(rule));
  }

  void read_variation(TomlTable& table, Rule& rule) {
    using Kind = Rule::Kind;
    constexpr std::array<std::pair<std::string_view, Kind>, 5> kinds = {{{"ignore", Kind::ignore},
                                                                         {"mask", Kind::mask},
                                                                         {"regex", Kind::regex},
                                                                         {"range", Kind::range},
                                                                         {"counter", Kind::counter}}};
    int given = 0;
    for (const auto& [key, kind] : kinds) {
      if (!table.has(key)) continue;
      rule.kind = kind;
      ++given;
    }
    if (rule.optional || rule.repeated) {
      if (given > 0)
        table.wrong(
            "is about the whole frame (optional, repeated) and about a part of it; accepted: a rule for "
            "each");
      rule.kind = Kind::frame;
      if (rule.when.empty() && rule.frame.empty())
        table.wrong("would let every frame be left out or repeated; say which by 'when' or 'frame'");
    } else if (given != 1) {
      for (const char* const key : {"at", "size", "to", "column", "separator", "capture", "length"})
        table.asks(key);
      table.wrong(
          "needs one of ignore, mask, regex, range, counter, optional, repeated: how the bytes may vary");
    } else {
      rule.place = read_place(table);
      read_length_bounds(table, rule);
    }
    read_values(table, rule);
  }

  void read_values(TomlTable& table, Rule& rule) {
    if (table.has("ignore") && !table.flag("ignore"))
      table.wrong("ignore", "is false; accepted: true, or another kind of rule");
    if (table.has("mask")) rule.mask = table.hex("mask").value_or(Bytes());
    rule.regex = read_expression(table, "regex");
    if (rule.kind == Rule::Kind::regex && table.has("regex") && rule.regex.empty())
      table.wrong("regex", "is empty; accepted: an expression of what may come, or ignore = true");
    if (const auto range = table.range("range")) std::tie(rule.least, rule.most) = *range;
    read_counter(table, rule);
    const bool is_number = rule.kind == Rule::Kind::range || rule.kind == Rule::Kind::counter;
    for (const char* const key : {"type", "order"}) {
      if (table.has(key) && !is_number)
        table.wrong(key, "has no meaning here: it is of a range or a counter");
    }
    rule.type = static_cast<NumberType>(table.choice("type", kTypes).value_or(0));
    rule.order = order_of(table);
    const bool binary = rule.type == NumberType::unsigned_ || rule.type == NumberType::signed_;
    if (is_number && binary && rule.place.by == Place::By::bytes && rule.place.size && *rule.place.size > 8)
      table.wrong("size", fmt::format("is {}; accepted: up to 8 bytes for a number", *rule.place.size));
    check_mask(table, rule);
  }

  static void check_mask(TomlTable& table, const Rule& rule) {
    if (rule.kind != Rule::Kind::mask || rule.mask.empty()) return;
    if (rule.length) table.wrong("length", "has no meaning with a mask");
    if (rule.place.size && static_cast<std::size_t>(*rule.place.size) != rule.mask.size())
      table.wrong("mask", fmt::format("has {} bytes, and the place has {}; accepted: as many",
                                      rule.mask.size(), *rule.place.size));
  }

  static void read_counter(TomlTable& table, Rule& rule) {
    if (!table.has("counter")) return;
    if (table.is_table("counter")) {
      auto counter = table.table("counter");
      rule.counter.modulo =
          static_cast<std::uint64_t>(counter->integer("modulo", 2, std::int64_t{1} << 62).value_or(0));
      counter->no_others();
    } else if (!table.flag("counter")) {
      table.wrong("counter", "is false; accepted: true, { modulo = … }, or another kind of rule");
    }
  }

  void read_length_bounds(TomlTable& table, Rule& rule) {
    const auto bounds = table.range("length");
    if (!bounds) return;
    const bool whole =
        std::floor(bounds->first) == bounds->first && std::floor(bounds->second) == bounds->second;
    if (!whole || bounds->first < 0 || bounds->second > static_cast<double>(kMostLength)) {
      return table.wrong("length", fmt::format("is [{}, {}]; accepted: whole numbers of bytes from 0 to {}",
                                               bounds->first, bounds->second, kMostLength));
    }
    rule.length =
        Rule::Length{static_cast<std::size_t>(bounds->first), static_cast<std::size_t>(bounds->second)};
    if (rule.place.by == Place::By::bytes && rule.place.size)
      table.wrong("length", "lets the length vary, and 'size' fixes it; accepted: 'to' instead of 'size'");
  }

  Place read_place(TomlTable& table) {
    Place place;
    const int given = static_cast<int>(table.has("at")) + static_cast<int>(table.has("column")) +
                      static_cast<int>(table.has("capture"));
    if (given != 1) {
      table.wrong("needs one of at, column, capture: where in the frame");
    } else {
      refuse_without(table, "at", {"size", "to"});
      refuse_without(table, "column", {"separator"});
    }
    place.at = table.integer("at", -kMostPosition, kMostPosition).value_or(0);
    place.size = table.integer("size", 1, kMostPosition);
    place.to = table.integer("to", -kMostPosition, kMostPosition);
    if (place.size && place.to) table.wrong("to", "is there besides 'size'; accepted: one of them");
    if (place.to && (*place.to < 0) == (place.at < 0) && *place.to <= place.at)
      table.wrong("to",
                  fmt::format("is {}, and 'at' is {}; accepted: a position behind it", *place.to, place.at));
    if (place.at < 0 && place.at + place.size.value_or(0) > 0)
      table.wrong("size", fmt::format("is {}, and from 'at' = {} to the frame's end there are {}",
                                      *place.size, place.at, -place.at));
    if (const auto column = table.integer("column", 0, 1000)) {
      place.by = Place::By::column;
      place.column = static_cast<int>(*column);
    }
    place.separator = table.text("separator").value_or(",");
    if (place.separator.empty()) table.wrong("separator", "is empty");
    place.capture = read_expression(table, "capture", 1);
    if (table.has("capture")) place.by = Place::By::capture;
    return place;
  }

  static void refuse_without(TomlTable& table, std::string_view place,
                             std::initializer_list<std::string_view> its_own) {
    if (table.has(place)) return;
    for (const std::string_view key : its_own) {
      if (table.has(key)) table.wrong(key, fmt::format("has no meaning here: it belongs to '{}'", place));
    }
  }

  Place read_named_place(TomlTable& table, std::string_view key) {
    auto place = table.table(key);
    if (!table.has(key))
      table.wrong(fmt::format(
          "has no '{}'; accepted: {{ at = …, size = … }}, {{ column = … }}, {{ capture = … }}", key));
    if (!place) return {};
    Place read = read_place(*place);
    place->no_others();
    return read;
  }

  void read_reply(TomlTable& table) {
    ReplyTemplate reply;
    reply.name = table.text("name").value_or("");
    reply.line = line_of(table);
    reply.frame = read_frame_name(table, "frame");
    reply.when = read_expression(table, "when");
    reply.from = read_named_place(table, "from");
    reply.answer_frame = read_frame_name(table, "answer_frame");
    reply.answer = read_expression(table, "answer");
    reply.to = read_named_place(table, "to");
    if (reply.name.empty()) table.wrong("lacks 'name': a name of its own");
    rules_.replies.push_back(std::move(reply));
  }

  void read_redaction(TomlTable& table) {
    RedactRule rule;
    rule.name = table.text("name").value_or("");
    if (rule.name.empty()) table.wrong("lacks 'name': a name of its own");
    const bool twice = std::any_of(rules_.redactions.begin(), rules_.redactions.end(),
                                   [&](const RedactRule& other) { return other.name == rule.name; });
    if (twice && !rule.name.empty())
      table.wrong("name", "is that of an earlier [[redact]]; accepted: one of its own");
    rule.line = line_of(table);
    if (const auto direction = table.choice("dir", kDirections))
      rule.direction = *direction == 0 ? Direction::read : Direction::write;
    read_secret(table, rule);
    read_filler(table, rule);
    rules_.redactions.push_back(std::move(rule));
  }

  void read_secret(TomlTable& table, RedactRule& rule) {
    using Kind = RedactRule::Kind;
    const bool pattern = table.has("pattern");
    const bool text = table.has("text") || table.has("text_hex");
    const bool range = table.has("offset");
    const bool place = table.has("at") || table.has("column") || table.has("capture");
    if (pattern + text + range + place != 1) {
      for (const char* const key : {"frame", "when", "at", "size", "to", "column", "separator", "capture",
                                    "pattern", "longest", "text", "text_hex", "offset", "events"})
        table.asks(key);
      return table.wrong("needs one of text, pattern, offset, at, column, capture: what is to be replaced");
    }
    rule.kind = pattern ? Kind::pattern : text ? Kind::text : range ? Kind::range : Kind::place;
    if (place) read_secret_place(table, rule);
    if (range) read_secret_range(table, rule);
    if (pattern) {
      rule.pattern = read_expression(table, "pattern");
      if (rule.pattern.empty()) table.wrong("pattern", "is empty; accepted: an expression of what is secret");
      rule.longest = static_cast<std::size_t>(table.integer("longest", 1, kMostLength).value_or(1024));
    }
    if (text) {
      rule.text = table.bytes("text").value_or(Bytes());
      if (rule.text.empty() || rule.text.size() > kMostLength)
        table.wrong("has a 'text' that is empty or of more than 65536 bytes");
    }
    if ((pattern || text) && table.has("events")) rule.events = table.flag("events");
  }

  void read_secret_place(TomlTable& table, RedactRule& rule) {
    if (rules_.frames.empty())
      table.wrong("is about a place in frames, and there is no [[frame]]; accepted: one, or text, pattern");
    rule.frame = read_frame_name(table, "frame");
    rule.when = read_expression(table, "when");
    rule.place = read_place(table);
  }

  static void read_secret_range(TomlTable& table, RedactRule& rule) {
    constexpr std::int64_t most = std::int64_t{1} << 62;
    rule.offset = table.integer("offset", 0, most).value_or(0);
    rule.size = table.integer("size", 1, most).value_or(1);
    if (!table.has("size")) table.wrong("has an 'offset' and no 'size': how many bytes");
    if (!rule.direction) table.wrong("has an 'offset' and no 'dir': of which stream; accepted: 'r', 'w'");
  }

  static void read_filler(TomlTable& table, RedactRule& rule) {
    const bool constant = table.has("with") || table.has("with_hex");
    if (constant && table.has("filler"))
      table.wrong("filler", "is there besides 'with'; accepted: one of them");
    rule.filler = static_cast<FillerKind>(table.choice("filler", kFillers).value_or(0));
    if (!constant) return;
    rule.filler = FillerKind::constant;
    rule.with = table.bytes("with").value_or(Bytes());
    if (rule.with.empty() || rule.with.size() > kMostLength)
      table.wrong("has a 'with' without bytes, or too many");
  }

  Problems problems_;
  RuleSet rules_;
  int steps_ = 0;  // of all expressions
};

}  // namespace

Result<RuleSet> read_rules(std::string_view text, const std::string& file) {
  return RulesReader(file).read(text);
}

}  // namespace porttape
