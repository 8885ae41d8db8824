// The lines of the events file, written and read: FORMAT.md, "The events file".

#include "libport/tape/event.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>
#include <span>
#include <type_traits>
#include <utility>

#include <boost/json/serialize.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_object.hpp"
#include "libport/line/line_settings_text.hpp"
#include "libport/tape/json_line.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

constexpr std::string_view kFormat = "porttape-events";
constexpr int kVersion = 1;
constexpr std::string_view kEventsDigest = "events_xxh3";
// The last key of a line that tells a digest of itself; 16 digits and kSealEnd follow.
constexpr std::string_view kSeal = R"(,"line_xxh3":")";
constexpr std::string_view kSealEnd = R"("})";
constexpr std::size_t kDigits = 16;
constexpr std::size_t kSealSize = kSeal.size() + kDigits + kSealEnd.size();

// The values that are words on the tape; the place is the value.
using Words = std::span<const std::string_view>;
constexpr auto kSides = std::to_array<std::string_view>({"driver", "device"});
constexpr auto kDirs = std::to_array<std::string_view>({"r", "w"});
constexpr auto kQueues = std::to_array<std::string_view>({"in", "out", "both"});
constexpr auto kTransports = std::to_array<std::string_view>({"stream", "datagram"});
constexpr auto kStamped = std::to_array<std::string_view>({"arrival", "read"});
constexpr auto kOrders = std::to_array<std::string_view>({"exact", "sampled"});
constexpr auto kStates = std::to_array<std::string_view>({"off", "on"});
constexpr auto kModemLines = std::to_array<std::string_view>({"dtr", "rts", "cts", "dsr", "cd", "ri"});
constexpr auto kParities =
    std::to_array({Parity::none, Parity::even, Parity::odd, Parity::mark, Parity::space});

template <class Value>
std::optional<Value> value_of(std::string_view word, Words words) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i] == word) return static_cast<Value>(i);
  }
  return std::nullopt;
}

// Writing.

// Cut between two characters.
std::string_view shortened(std::string_view text) {
  if (text.size() <= kMaxEventText) return text;
  std::size_t length = kMaxEventText;
  while (length > kMaxEventText - 4 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) --length;
  return text.substr(0, length);
}

void put(JsonObject& line, std::string_view key, std::string_view text) { line.add(key, shortened(text)); }

template <std::same_as<StrangerText> Text>
void put(JsonObject& line, std::string_view key, const Text& text) {
  put(line, key, text.raw());
}

template <class Text>
void put_if(JsonObject& line, std::string_view key, const Text& text) {
  if (!text.empty()) put(line, key, text);
}

template <class Value>
void put_word(JsonObject& line, std::string_view key, const std::optional<Value>& value, Words words) {
  if (value) line.add(key, words[static_cast<std::size_t>(*value)]);
}

void put(JsonObject& line, const TapeZero& zero) {
  put(line, "wall", zero.wall);
  line.add("monotonic_us", zero.monotonic_us);
  put_if(line, "boot", zero.boot);
}

void put(JsonObject& line, const PortIdentity& port) {
  put(line, "path", port.path);
  for (const auto& [key, id] : {std::pair("vid", port.vid), std::pair("pid", port.pid)}) {
    if (id) put(line, key, usb_id_text(*id));
  }
  put_if(line, "serial", port.serial);
  put_if(line, "manufacturer", port.manufacturer);
  put_if(line, "product", port.product);
  if (port.interface) line.add("interface", *port.interface);
  put_if(line, "driver", port.driver);
}

void put(JsonObject& line, const TapeOrigin& origin) {
  put(line, "by", origin.by);
  JsonList tapes;
  for (const PreviousTape& tape : origin.tapes) {
    JsonObject each;
    put_if(each, "id", tape.id);
    put(each, "name", tape.name);
    tapes.add(each);
  }
  line.add("tapes", tapes);
  if (origin.from) line.add("from_us", origin.from->count());
}

void put(JsonObject& line, std::string_view key, const std::optional<PayloadTotals>& totals) {
  if (!totals) return;
  JsonObject object;
  object.add("blocks", totals->blocks).add("bytes", totals->bytes);
  if (totals->xxh3) object.add("xxh3", digest_text(*totals->xxh3));
  if (totals->xxh3_all) object.add("xxh3_all", digest_text(*totals->xxh3_all));
  line.add_raw(key, object.str());
}

// The keys of each kind; a kind without members has none.
template <class Kind>
requires std::is_empty_v<Kind>
void put(JsonObject&, const Kind&) {}
void put(JsonObject&, const event::Unknown&) {}
void put(JsonObject& line, const event::DeviceLost& lost) {
  put(line, "why", lost.why);
  if (lost.hung_up) line.add_raw("hung_up", "true");
}
void put(JsonObject& line, const event::HalfClose& half_close) {
  put_word(line, "by", half_close.by, kSides);
}
void put(JsonObject& line, const event::Zero& zero) { put(line, zero.zero); }
void put(JsonObject& line, const event::Settings& settings) {
  put_word(line, "by", settings.by, kSides);
  add_settings(line, settings.line);
  put_word(line, "order", settings.order, kOrders);
}
void put(JsonObject& line, const event::Flush& flush) { put_word(line, "queue", flush.queue, kQueues); }
void put(JsonObject& line, const event::Modem& modem) {
  put_word(line, "line", modem.line, kModemLines);
  put_word(line, "state", modem.on, kStates);
  put_word(line, "by", modem.by, kSides);
}
void put(JsonObject& line, const event::Break& signal) {
  put_word(line, "state", signal.on, kStates);
  put_word(line, "by", signal.by, kSides);
}
void put(JsonObject& line, const event::Drain& drain) { line.add("took_us", drain.took.count()); }
void put(JsonObject& line, const event::Mark& mark) { put(line, "text", mark.text); }
void put(JsonObject& line, const event::Gap& gap) {
  line.add("bytes", gap.bytes);
  if (gap.from) line.add("from_us", to_us(*gap.from));
  put(line, "why", gap.why);
}
void put(JsonObject& line, const event::Fault& event) {
  const LineFault& fault = event.fault;
  put(line, "kind", fault.kind);
  put_word(line, "dir", fault.dir, kDirs);
  if (fault.offset) line.add("offset", *fault.offset);
  if (fault.count > 0) line.add("count", fault.count);
  put_if(line, "spec", fault.spec);
  if (fault.seed) line.add("seed", *fault.seed);
}
void put(JsonObject& line, const event::End& end) {
  put(line, "read", end.read);
  put(line, "write", end.write);
  if (end.events) line.add(kEventsDigest, digest_text(*end.events));
}

// Reading.

std::string text_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const json::string* text = value == nullptr ? nullptr : value->if_string();
  return text == nullptr ? std::string() : std::string(text->data(), text->size());
}

// A whole number that is not negative.
std::optional<std::int64_t> number_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const std::int64_t* number = value == nullptr ? nullptr : value->if_int64();
  if (number == nullptr || *number < 0) return std::nullopt;
  return *number;
}

// When a gap began, which may be before its tape did.
std::optional<std::int64_t> gap_begin(const json::object& line) {
  const json::value* value = line.if_contains("from_us");
  const std::int64_t* number = value == nullptr ? nullptr : value->if_int64();
  return number == nullptr ? std::nullopt : std::optional(*number);
}

const json::object* object_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  return value == nullptr ? nullptr : value->if_object();
}

std::optional<std::uint64_t> count_of(const json::object& object, std::string_view key) {
  const auto number = number_of(object, key);
  return number ? std::optional(static_cast<std::uint64_t>(*number)) : std::nullopt;
}

std::optional<unsigned> number_within(const json::object& object, std::string_view key, std::int64_t least,
                                      std::int64_t most) {
  const auto number = number_of(object, key);
  if (!number || *number < least || *number > most) return std::nullopt;
  return static_cast<unsigned>(*number);
}

std::optional<bool> flag_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  if (value == nullptr || !value->is_bool()) return std::nullopt;
  return value->get_bool();
}

bool is_true(const json::object& object, std::string_view key) {
  return flag_of(object, key).value_or(false);
}

std::optional<Parity> parity_of(const std::string& word) {
  for (const Parity parity : kParities) {
    if (to_string(parity) == word) return parity;
  }
  return std::nullopt;
}

SeenSettings settings_of(const json::object& line) {
  return {.baud = number_within(line, "baud", 0, std::numeric_limits<unsigned>::max()),
          .data_bits = number_within(line, "databits", 5, 8),
          .parity = parity_of(text_of(line, "parity")),
          .stop_bits = number_within(line, "stopbits", 1, 2),
          .hw_flow = flag_of(line, "hwflowctrl"),
          .sw_flow = flag_of(line, "swflowctrl")};
}

TapeZero zero_of(const json::object& object) {
  return {text_of(object, "wall"), number_of(object, "monotonic_us").value_or(0), text_of(object, "boot")};
}

PortIdentity identity_of(const json::object& object) {
  PortIdentity port;
  port.path = text_of(object, "path");
  port.vid = usb_id_of(text_of(object, "vid"));
  port.pid = usb_id_of(text_of(object, "pid"));
  port.serial = text_of(object, "serial");
  port.manufacturer = text_of(object, "manufacturer");
  port.product = text_of(object, "product");
  if (const auto number = number_within(object, "interface", 0, 255))
    port.interface = static_cast<std::uint8_t>(*number);
  port.driver = text_of(object, "driver");
  return port;
}

TapeOrigin origin_of(const json::object& object) {
  constexpr std::size_t most = 1000;
  TapeOrigin origin{text_of(object, "by"), {}, {}};
  const json::value* value = object.if_contains("tapes");
  const json::array* tapes = value == nullptr ? nullptr : value->if_array();
  for (std::size_t i = 0; tapes != nullptr && i < std::min(tapes->size(), most); ++i) {
    if (const json::object* tape = (*tapes)[i].if_object())
      origin.tapes.push_back({text_of(*tape, "id"), text_of(*tape, "name")});
  }
  if (const auto from = number_of(object, "from_us")) origin.from = Micros(*from);
  return origin;
}

std::optional<std::uint64_t> number_of_digest(const std::string& hex) {
  std::uint64_t digest = 0;
  const auto [end, error] = std::from_chars(hex.data(), hex.data() + hex.size(), digest, 16);
  if (hex.size() != kDigits || error != std::errc() || end != hex.data() + hex.size()) return std::nullopt;
  return digest;
}

std::optional<PayloadTotals> totals_of(const json::object* object) {
  if (object == nullptr) return std::nullopt;
  const auto blocks = number_of(*object, "blocks");
  const auto bytes = number_of(*object, "bytes");
  if (!blocks || !bytes) return std::nullopt;
  return PayloadTotals{static_cast<std::uint64_t>(*blocks), static_cast<std::uint64_t>(*bytes),
                       number_of_digest(text_of(*object, "xxh3")),
                       number_of_digest(text_of(*object, "xxh3_all"))};
}

// The keys of each kind, as put() wrote them.
template <class Kind>
requires std::is_empty_v<Kind>
void take(const json::object&, Kind&) {}
void take(const json::object& line, event::DeviceLost& lost) {
  lost = {text_of(line, "why"), is_true(line, "hung_up")};
}
void take(const json::object& line, event::HalfClose& half_close) {
  half_close.by = value_of<Side>(text_of(line, "by"), kSides);
}
void take(const json::object& line, event::Zero& zero) { zero.zero = zero_of(line); }
void take(const json::object& line, event::Settings& settings) {
  settings = {value_of<Side>(text_of(line, "by"), kSides), settings_of(line),
              value_of<SettingsOrder>(text_of(line, "order"), kOrders)};
}
void take(const json::object& line, event::Flush& flush) {
  flush.queue = value_of<FlushQueue>(text_of(line, "queue"), kQueues);
}
void take(const json::object& line, event::Modem& modem) {
  modem = {value_of<LineSignal::Name>(text_of(line, "line"), kModemLines),
           value_of<bool>(text_of(line, "state"), kStates), value_of<Side>(text_of(line, "by"), kSides)};
}
void take(const json::object& line, event::Break& signal) {
  signal = {value_of<bool>(text_of(line, "state"), kStates), value_of<Side>(text_of(line, "by"), kSides)};
}
void take(const json::object& line, event::Drain& drain) {
  drain.took = Micros{number_of(line, "took_us").value_or(0)};
}
void take(const json::object& line, event::Mark& mark) { mark.text = text_of(line, "text"); }
void take(const json::object& line, event::Gap& gap) {
  gap.bytes = count_of(line, "bytes").value_or(0);
  if (const auto from = gap_begin(line)) gap.from = tape_time_us(std::max<std::int64_t>(0, *from));
  gap.why = text_of(line, "why");
}
void take(const json::object& line, event::Fault& event) {
  event.fault = {.kind = text_of(line, "kind"),
                 .spec = text_of(line, "spec"),
                 .dir = value_of<LineDir>(text_of(line, "dir"), kDirs),
                 .offset = count_of(line, "offset"),
                 .count = count_of(line, "count").value_or(0),
                 .seed = count_of(line, "seed")};
}
void take(const json::object& line, event::End& end) {
  end = {totals_of(object_of(line, "read")), totals_of(object_of(line, "write")),
         number_of_digest(text_of(line, kEventsDigest))};
}

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
  line.erase(kEventsDigest);
}

// The event of that name among the kinds of the variant.
template <class... Kinds>
Event event_of(std::string name, const json::object& line,
               std::type_identity<std::variant<event::Unknown, Kinds...>>) {
  Event found;
  const auto take_if = [&]<class Kind>(std::type_identity<Kind>) {
    if (name != Kind::kName) return false;
    take(line, found.emplace<Kind>());
    return true;
  };
  if (!(take_if(std::type_identity<Kinds>()) || ...)) found = event::Unknown{std::move(name)};
  return found;
}

}  // namespace

Event signal_event(const TapedSignal& signal) {
  if (signal.signal.name == LineSignal::Name::brk) return event::Break{signal.signal.on, signal.by};
  return event::Modem{signal.signal.name, signal.signal.on, signal.by};
}

std::optional<TapedSignal> signal_of(const Event& event) {
  if (const auto* modem = std::get_if<event::Modem>(&event); modem != nullptr && modem->line && modem->on)
    return TapedSignal{modem->by.value_or(is_output(*modem->line) ? Side::driver : Side::device),
                       {*modem->line, *modem->on}};
  if (const auto* signal = std::get_if<event::Break>(&event); signal != nullptr && signal->on)
    return TapedSignal{signal->by.value_or(Side::driver), {LineSignal::Name::brk, *signal->on}};
  return std::nullopt;
}

std::optional<Event> event_of(const TapedLineEvent& event) {
  using Taped = std::optional<Event>;
  const bool by_driver = event.by == Side::driver;
  return std::visit(
      LineVisitor{
          [&](const line::Flush& flush) { return by_driver ? Taped(event::Flush{flush.queue}) : Taped(); },
          [&](const line::Settings& settings) {
            return Taped(event::Settings{event.by, settings.seen, settings.order});
          },
          [&](const LineSignal& signal) {
            return Taped(signal_event({event.by, signal}));
          },
          [&](const line::Dropped& lost) {
            return by_driver ? Taped() : Taped(event::Gap{lost.bytes, std::nullopt, std::string(lost.why)});
          },
          [](const line::Mark& mark) { return Taped(event::Mark{mark.text}); },
          [&](const LineFault& fault) { return by_driver ? Taped() : Taped(event::Fault{fault}); },
          [](const auto&) { return Taped(); },
      },
      event.what);
}

std::optional<TapedLineEvent> line_event_of(const Event& event) {
  if (const auto* flush = std::get_if<event::Flush>(&event))
    return TapedLineEvent{Side::driver, line::Flush{flush->queue.value_or(FlushQueue::both)}};
  if (const auto* settings = std::get_if<event::Settings>(&event); settings != nullptr && settings->by)
    return TapedLineEvent{*settings->by,
                          line::Settings{settings->line, settings->order.value_or(SettingsOrder::exact)}};
  if (const auto signal = signal_of(event)) return TapedLineEvent{signal->by, signal->signal};
  return std::nullopt;
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
  std::visit([&](const auto& kind) { put(line, kind); }, event);
  const auto* end = std::get_if<event::End>(&event);
  return (end != nullptr && end->events ? sealed(line.str()) : line.str()) + '\n';
}

std::string encode(const TapeHeader& header) {
  JsonObject line;
  line.add("format", kFormat).add("version", kVersion);
  put(line, "created", header.created);
  put_if(line, "id", header.id);
  if (header.zero) {
    JsonObject zero;
    put(zero, *header.zero);
    line.add_raw("zero", zero.str());
  }
  put(line, "device", header.device);
  put(line, "driver", header.driver);
  put_word(line, "transport", header.transport, kTransports);
  put_word(line, "stamped", header.stamped, kStamped);
  if (header.previous) {
    JsonObject previous;
    put(previous, "id", header.previous->id);
    put(previous, "name", header.previous->name);
    line.add_raw("previous", previous.str());
  }
  if (header.identity) {
    JsonObject identity;
    put(identity, *header.identity);
    line.add_raw("identity", identity.str());
  }
  if (header.origin) {
    JsonObject origin;
    put(origin, *header.origin);
    line.add_raw("origin", origin.str());
  }
  put(line, "host", header.host);
  put(line, "tool", header.tool);
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
    const auto from = is_gap ? gap_begin(*object) : std::nullopt;
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
  return value.is_object() && is_true(value.get_object(), "carried");
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
  if (object == nullptr || text_of(*object, "format") != kFormat) {
    return make_error(Errc::damaged_tape, "not an events file: its first line is no porttape-events header");
  }
  if (const auto number = number_of(*object, "version"); number != kVersion) {
    return make_error(Errc::not_a_tape, "an events file of version " +
                                            (number ? std::to_string(*number) : "?") +
                                            "; this porttape reads version " + std::to_string(kVersion));
  }
  TapeHeader header{text_of(*object, "device"), text_of(*object, "driver"), text_of(*object, "created"),
                    text_of(*object, "host"),   text_of(*object, "tool"),   text_of(*object, "id")};
  if (const json::object* zero = object_of(*object, "zero")) header.zero = zero_of(*zero);
  header.transport = value_of<Transport>(text_of(*object, "transport"), kTransports);
  header.stamped = value_of<Stamped>(text_of(*object, "stamped"), kStamped);
  if (const json::object* previous = object_of(*object, "previous")) {
    header.previous = PreviousTape{text_of(*previous, "id"), text_of(*previous, "name")};
  }
  if (const json::object* identity = object_of(*object, "identity")) {
    header.identity = identity_of(*identity);
    if (const Result<void> checked = check_identity(*header.identity); !checked) {
      header.identity_refused = checked.error().message;
      header.identity.reset();
    }
  }
  if (const json::object* origin = object_of(*object, "origin")) header.origin = origin_of(*origin);
  return header;
}

}  // namespace porttape
