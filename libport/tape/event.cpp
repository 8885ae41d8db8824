// The lines of the events file, written and read: FORMAT.md, "The events file".

#include "libport/tape/event.hpp"

#include <algorithm>
#include <charconv>
#include <concepts>
#include <type_traits>
#include <utility>

#include <boost/json/serialize.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_object.hpp"
#include "libport/tape/event_keys.hpp"
#include "libport/tape/json_line.hpp"

namespace porttape {
namespace {

namespace json = boost::json;
using event_keys::Words;

constexpr int kVersion = 1;
// The last key of a line that tells a digest of itself; 16 digits and kSealEnd follow.
constexpr std::string_view kSeal = R"(,"line_xxh3":")";
constexpr std::string_view kSealEnd = R"("})";
constexpr std::size_t kDigits = 16;
constexpr std::size_t kSealSize = kSeal.size() + kDigits + kSealEnd.size();

// Cut between two characters.
std::string_view shortened(std::string_view text) {
  if (text.size() <= kMaxEventText) return text;
  std::size_t length = kMaxEventText;
  while (length > kMaxEventText - 4 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) --length;
  return text.substr(0, length);
}

std::string_view raw(const std::string& text) { return text; }
std::string_view raw(const StrangerText& text) { return text.raw(); }

// Writes keys: see event_keys.hpp.
class KeyWriter {
 public:
  explicit KeyWriter(JsonObject& line) : line_(line) {}

  template <class... Known>
  void text(std::string_view key, const auto& text, const Known&...) {
    line_.add(key, shortened(raw(text)));
  }
  template <class... Known>
  void text_if(std::string_view key, const auto& text, const Known&...) {
    if (!text.empty()) this->text(key, text);
  }
  template <class Value>
  void word(std::string_view key, const std::optional<Value>& value, Words words) {
    if (value) line_.add(key, words[static_cast<std::size_t>(*value)]);
  }
  template <std::integral Number>
  void number(std::string_view key, Number number) {
    line_.add(key, number);
  }
  void number(std::string_view key, Micros number) { line_.add(key, number.count()); }
  template <class Number, class... Bounds>
  void number(std::string_view key, const std::optional<Number>& number, Bounds...) {
    if (number) this->number(key, *number);
  }
  void number_if(std::string_view key, std::uint64_t number) {
    if (number > 0) line_.add(key, number);
  }
  void needed(std::string_view key, std::uint64_t number) { line_.add(key, number); }
  void flag(std::string_view key, bool on) {
    if (on) line_.add_raw(key, "true");
  }
  void flag(std::string_view key, const std::optional<bool>& on) {
    if (on) line_.add_raw(key, *on ? "true" : "false");
  }
  void moment(std::string_view key, const std::optional<TapeTime>& at) {
    if (at) line_.add(key, to_us(*at));
  }
  void digest(std::string_view key, const std::optional<std::uint64_t>& digest) {
    if (digest) line_.add(key, digest_text(*digest));
  }
  void usb_id(std::string_view key, const std::optional<std::uint16_t>& id) {
    if (id) line_.add(key, usb_id_text(*id));
  }
  template <class Value>
  void object(std::string_view key, const std::optional<Value>& value) {
    if (value) line_.add(key, object_of(*value));
  }
  template <class Value>
  void list(std::string_view key, const std::vector<Value>& values) {
    JsonList list;
    for (const Value& value : values) list.add(object_of(value));
    line_.add(key, list);
  }
  void members(const auto& value) { event_keys::tell(value, *this); }

 private:
  static JsonObject object_of(const auto& value) {
    JsonObject object;
    KeyWriter(object).members(value);
    return object;
  }
  JsonObject& line_;
};

std::string text_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const json::string* text = value == nullptr ? nullptr : value->if_string();
  return text == nullptr ? std::string() : std::string(text->data(), text->size());
}

std::optional<std::int64_t> signed_number_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const std::int64_t* number = value == nullptr ? nullptr : value->if_int64();
  return number == nullptr ? std::nullopt : std::optional(*number);
}

// A whole number that is not negative.
std::optional<std::int64_t> number_of(const json::object& object, std::string_view key) {
  const auto number = signed_number_of(object, key);
  return number && *number >= 0 ? number : std::nullopt;
}

std::optional<bool> flag_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  if (value == nullptr || !value->is_bool()) return std::nullopt;
  return value->get_bool();
}

std::optional<std::uint64_t> number_of_digest(const std::string& hex) {
  std::uint64_t digest = 0;
  const auto [end, error] = std::from_chars(hex.data(), hex.data() + hex.size(), digest, 16);
  if (hex.size() != kDigits || error != std::errc() || end != hex.data() + hex.size()) return std::nullopt;
  return digest;
}

// Reads keys: see event_keys.hpp. Of a list at most kMostListed are read.
class KeyReader {
 public:
  static constexpr std::size_t kMostListed = 1000;

  explicit KeyReader(const json::object& line) : line_(line) {}

  template <class... Known>
  void text(std::string_view key, auto& text, const Known&...) {
    text = text_of(line_, key);
  }
  template <class... Known>
  void text_if(std::string_view key, auto& text, const Known&...) {
    text = text_of(line_, key);
  }
  template <class Value>
  void word(std::string_view key, std::optional<Value>& value, Words words) {
    const auto found = std::ranges::find(words, text_of(line_, key));
    value = found == words.end() ? std::nullopt : std::optional(static_cast<Value>(found - words.begin()));
  }
  template <std::integral Number>
  void number(std::string_view key, Number& number) {
    number = static_cast<Number>(number_of(line_, key).value_or(0));
  }
  void number(std::string_view key, Micros& number) { number = Micros{number_of(line_, key).value_or(0)}; }
  template <class Number>
  void number(std::string_view key, std::optional<Number>& number, std::int64_t least = 0,
              std::int64_t most = std::numeric_limits<std::int64_t>::max()) {
    const auto read = number_of(line_, key);
    number =
        read && *read >= least && *read <= most ? std::optional(static_cast<Number>(*read)) : std::nullopt;
  }
  void number_if(std::string_view key, std::uint64_t& number) { this->number(key, number); }
  void needed(std::string_view key, std::uint64_t& number) {
    this->number(key, number);
    is_whole_ = is_whole_ && number_of(line_, key);
  }
  void flag(std::string_view key, bool& on) { on = flag_of(line_, key).value_or(false); }
  void flag(std::string_view key, std::optional<bool>& on) { on = flag_of(line_, key); }
  // A gap may have begun before its tape did.
  void moment(std::string_view key, std::optional<TapeTime>& at) {
    at.reset();
    if (const auto us = signed_number_of(line_, key)) at = tape_time_us(std::max<std::int64_t>(0, *us));
  }
  void digest(std::string_view key, std::optional<std::uint64_t>& digest) {
    digest = number_of_digest(text_of(line_, key));
  }
  void usb_id(std::string_view key, std::optional<std::uint16_t>& id) { id = usb_id_of(text_of(line_, key)); }
  template <class Value>
  void object(std::string_view key, std::optional<Value>& value) {
    const json::value* const found = line_.if_contains({key.data(), key.size()});
    value = found == nullptr ? std::nullopt : value_of<Value>(*found);
  }
  template <class Value>
  void list(std::string_view key, std::vector<Value>& values) {
    const json::value* const found = line_.if_contains({key.data(), key.size()});
    const json::array* const list = found == nullptr ? nullptr : found->if_array();
    for (std::size_t i = 0; list != nullptr && i < std::min(list->size(), kMostListed); ++i) {
      if (auto value = value_of<Value>((*list)[i])) values.push_back(std::move(*value));
    }
  }
  void members(auto& value) { event_keys::tell(value, *this); }

 private:
  template <class Value>
  static std::optional<Value> value_of(const json::value& json) {
    const json::object* const object = json.if_object();
    if (object == nullptr) return std::nullopt;
    Value value;
    KeyReader keys(*object);
    keys.members(value);
    return keys.is_whole_ ? std::optional(std::move(value)) : std::nullopt;
  }
  const json::object& line_;
  bool is_whole_ = true;
};

// Seals.

std::string seal_of(std::string_view before) { return digest_text(digest_of(as_bytes(before))); }

// `line` is a JSON object.
std::string sealed(std::string line) {
  line.pop_back();
  const std::string seal = seal_of(line);
  return line.append(kSeal).append(seal).append(kSealEnd);
}

bool has_seal(std::string_view line) {
  return line.size() > kSealSize && line.substr(line.size() - kSealSize).starts_with(kSeal) &&
         line.ends_with(kSealEnd);
}

// What is changed by hand or moved is not as it was sealed.
void unseal(json::object& line) {
  line.erase("line_xxh3");
  line.erase(event::End::kEventsDigest);
}

// The event of that name among the kinds of the variant.
template <class... Kinds>
Event event_of(std::string name, const json::object& line,
               std::type_identity<std::variant<event::Unknown, Kinds...>>) {
  Event found;
  const auto take_if = [&]<class Kind>(std::type_identity<Kind>) {
    if (name != Kind::kName) return false;
    KeyReader(line).members(found.emplace<Kind>());
    return true;
  };
  if (!(take_if(std::type_identity<Kinds>()) || ...)) found = event::Unknown{std::move(name)};
  return found;
}

// The first kind of the variant that holds it.
template <class What, class... Kinds>
std::optional<Event> event_of(Side by, const What& what, std::type_identity<std::variant<Kinds...>>) {
  std::optional<Event> made;
  const auto make_if = [&]<class Kind>(std::type_identity<Kind>) {
    if constexpr (requires { Kind::of(by, what); }) {
      if (auto kind = Kind::of(by, what)) made.emplace(std::move(*kind));
    }
    return made.has_value();
  };
  (void)(make_if(std::type_identity<Kinds>()) || ...);
  return made;
}

}  // namespace

std::optional<Event> event_of(const TapedLineEvent& event) {
  return std::visit([&](const auto& what) { return event_of(event.by, what, std::type_identity<Event>()); },
                    event.what);
}

std::optional<TapedLineEvent> line_event_of(const Event& event) {
  return std::visit(
      [](const auto& kind) -> std::optional<TapedLineEvent> {
        if constexpr (requires { kind.line_event(); }) {
          return kind.line_event();
        } else {
          return std::nullopt;
        }
      },
      event);
}

Event signal_event(const TapedSignal& signal) { return *event_of({signal.by, signal.signal}); }

std::optional<TapedSignal> signal_of(const Event& event) {
  const auto taped = line_event_of(event);
  const auto* const signal = taped ? std::get_if<LineSignal>(&taped->what) : nullptr;
  return signal == nullptr ? std::nullopt : std::optional(TapedSignal{taped->by, *signal});
}

std::string_view name_of(const Event& event) {
  return std::visit(
      []<class Kind>(const Kind& kind) -> std::string_view {
        if constexpr (std::is_same_v<Kind, event::Unknown>) {
          return kind.kind.raw();
        } else {
          return Kind::kName;
        }
      },
      event);
}

std::string encode(TapeTime at, const Event& event) {
  JsonObject line;
  line.add("t_us", to_us(at)).add("event", name_of(event));
  std::visit(
      [&]<class Kind>(const Kind& kind) {
        if constexpr (!std::is_same_v<Kind, event::Unknown>) KeyWriter(line).members(kind);
      },
      event);
  const auto* end = std::get_if<event::End>(&event);
  return (end != nullptr && end->events ? sealed(line.str()) : line.str()) + '\n';
}

std::string encode(const TapeHeader& header) {
  JsonObject line;
  line.add("format", event_keys::kFormats.front()).add("version", kVersion);
  KeyWriter(line).members(header);
  return line.str() + '\n';
}

Result<TapeEvent> decode_event(std::string_view line) {
  const auto damage = [](const char* reason) { return make_error(Errc::damaged_tape, reason); };
  const json::value value = parse_json_line(line);
  const json::object* object = value.if_object();
  if (object == nullptr) return damage("not a JSON object");
  const auto at = number_of(*object, "t_us");
  if (!at) return damage("no t_us, or it is not a number of microseconds");
  // Readers take the latest time of all for the end of a file.
  if (tape_time_us(*at) == TapeTime::max()) return damage("t_us is later than any tape can be");
  std::string name = text_of(*object, "event");
  if (name.empty()) return damage("no event");
  return TapeEvent{tape_time_us(*at), event_of(std::move(name), *object, std::type_identity<Event>())};
}

Result<void> check_seal(std::string_view line, const Event& event) {
  const auto changed = [](const char* how) {
    return make_error(Errc::damaged_tape,
                      std::string("the line is not as it was written: its own digest, line_xxh3, is ") + how);
  };
  const auto* end = std::get_if<event::End>(&event);
  const bool is_sealed = has_seal(line);
  if (!is_sealed && end != nullptr && end->events) return changed("missing");
  if (!is_sealed) return {};
  const std::string_view seal = line.substr(line.size() - kSealEnd.size() - kDigits, kDigits);
  if (seal != seal_of(line.substr(0, line.size() - kSealSize))) return changed("another");
  return {};
}

std::string encode_again(std::string_view line, TapeTime at) {
  json::value value = parse_json_line(line);
  if (json::object* object = value.if_object()) {
    unseal(*object);
    const bool is_gap = text_of(*object, "event") == event::Gap::kName;
    const auto from = is_gap ? signed_number_of(*object, "from_us") : std::nullopt;
    const auto was = number_of(*object, "t_us");
    std::int64_t moved = 0;
    if (from && was && !__builtin_add_overflow(*from, to_us(at) - *was, &moved)) (*object)["from_us"] = moved;
    (*object)["t_us"] = to_us(at);
  }
  return json::serialize(value) + '\n';
}

std::string encode_carried(std::string_view line, TapeTime at) {
  json::value value = parse_json_line(line);
  if (json::object* object = value.if_object()) {
    unseal(*object);
    (*object)["t_us"] = to_us(at);
    (*object)["carried"] = true;
  }
  return json::serialize(value) + '\n';
}

// Asked of each event of a tape: most lines have no such word.
bool is_carried(std::string_view line) {
  if (line.find("\"carried\"") == std::string_view::npos) return false;
  const json::value value = parse_json_line(line);
  return value.is_object() && flag_of(value.get_object(), "carried").value_or(false);
}

std::string encode_again(std::string_view line, const TapeHeader& changed) {
  const std::string made = encode(changed);
  json::value value = parse_json_line(line);
  const json::value other = parse_json_line(made);
  if (!value.is_object() || !other.is_object()) return made;
  json::object& object = value.get_object();
  for (const char* const key : {"created", "id", "zero", "previous", "origin"}) {
    if (const json::value* told = other.get_object().if_contains(key)) {
      object[key] = *told;
    } else {
      object.erase(key);
    }
  }
  return json::serialize(value) + '\n';
}

Result<TapeHeader> decode_header(std::string_view line) {
  const json::value value = parse_json_line(line);
  const json::object* object = value.if_object();
  if (object == nullptr || text_of(*object, "format") != event_keys::kFormats.front()) {
    return make_error(Errc::damaged_tape, "not an events file: its first line is no porttape-events header");
  }
  if (const auto number = number_of(*object, "version"); number != kVersion) {
    return make_error(Errc::not_a_tape, "an events file of version " +
                                            (number ? std::to_string(*number) : "?") +
                                            "; this porttape reads version " + std::to_string(kVersion));
  }
  TapeHeader header;
  KeyReader(*object).members(header);
  const Result<void> checked = header.identity ? check_identity(*header.identity) : Result<void>();
  if (!checked) {
    header.identity_refused = checked.error().message;
    header.identity.reset();
  }
  return header;
}

}  // namespace porttape
