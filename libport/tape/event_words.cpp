#include "libport/tape/event_words.hpp"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <span>
#include <type_traits>
#include <variant>

#include "libport/tape/event.hpp"

namespace porttape::event_words {
namespace {

using KeyList = std::span<const std::string_view>;

constexpr auto kEveryEvent = std::to_array<std::string_view>({"t_us", "event", "carried"});
constexpr auto kFormatKeys = std::to_array<std::string_view>(
    {"format",  "version",  "created",    "id",           "zero",     "wall",      "monotonic_us", "boot",
     "device",  "driver",   "transport",  "stamped",      "previous", "name",      "identity",     "path",
     "vid",     "pid",      "serial",     "manufacturer", "product",  "interface", "origin",       "by",
     "tapes",   "from_us",  "host",       "tool",         "why",      "hung_up",   "baud",         "databits",
     "parity",  "stopbits", "hwflowctrl", "swflowctrl",   "order",    "queue",     "line",         "state",
     "took_us", "text",     "kind",       "dir",          "offset",   "spec",      "seed",         "count",
     "bytes",   "read",     "write",      "blocks",       "xxh3"});
constexpr auto kFormatNumbers = std::to_array<std::string_view>(
    {"t_us", "version", "monotonic_us", "interface", "from_us", "baud", "databits", "stopbits", "took_us",
     "offset", "seed", "count", "bytes", "blocks"});

bool holds(KeyList list, std::string_view word) { return std::ranges::find(list, word) != list.end(); }

bool is_hex_of(std::string_view text, std::size_t digits) {
  return text.size() == digits && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}
bool is_id(std::string_view text) { return is_hex_of(text, 32); }
bool is_digest(std::string_view text) { return is_hex_of(text, 16); }

// RFC 3339, in whatever precision, or a boot_id: '9' stands for a digit, 'f' for a hexadecimal one.
bool is_of_form(std::string_view text, std::string_view form) {
  return text.size() == form.size() && std::ranges::equal(text, form, [](char c, char wanted) {
           const bool digit = c >= '0' && c <= '9';
           if (wanted == '9') return digit;
           return wanted == 'f' ? digit || (c >= 'a' && c <= 'f') : c == wanted;
         });
}
bool is_moment(std::string_view text) {
  return is_of_form(text, "9999-99-99T99:99:99Z") || is_of_form(text, "9999-99-99T99:99:99.999999Z");
}
bool is_boot(std::string_view text) { return is_of_form(text, "ffffffff-ffff-ffff-ffff-ffffffffffff"); }

bool is_in(std::string_view text, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), text) != words.end();
}
bool is_format(std::string_view text) { return text == "porttape-events"; }
bool is_transport(std::string_view text) { return is_in(text, {"stream", "datagram"}); }
bool is_stamped(std::string_view text) { return is_in(text, {"arrival", "read"}); }
bool is_making_verb(std::string_view text) {
  return is_in(text, {"cut", "split", "merge", "recover", "redact", "convert", "shrink"});
}
bool is_side(std::string_view text) { return is_in(text, {"driver", "device"}); }
bool is_parity(std::string_view text) { return is_in(text, {"none", "even", "odd", "mark", "space"}); }
bool is_order(std::string_view text) { return is_in(text, {"exact", "sampled"}); }
bool is_queue(std::string_view text) { return is_in(text, {"in", "out", "both"}); }
bool is_modem_line(std::string_view text) { return is_in(text, {"dtr", "rts", "cts", "dsr", "cd", "ri"}); }
bool is_state(std::string_view text) { return is_in(text, {"on", "off"}); }
bool is_dir(std::string_view text) { return is_in(text, {"r", "w"}); }
bool is_fault(std::string_view text) {
  return is_in(text, {"drop", "corrupt", "duplicate", "delay", "stall", "truncate", "hangup", "replug",
                      "plan", "more"});
}

struct Word {
  std::string_view kind;
  std::string_view path;
  bool (*is_word)(std::string_view text);
};
constexpr auto kWords = std::to_array<Word>({{kHeader, "format", is_format},
                                             {kHeader, "created", is_moment},
                                             {kHeader, "id", is_id},
                                             {kHeader, "zero.wall", is_moment},
                                             {kHeader, "zero.boot", is_boot},
                                             {kHeader, "transport", is_transport},
                                             {kHeader, "stamped", is_stamped},
                                             {kHeader, "previous.id", is_id},
                                             {kHeader, "origin.by", is_making_verb},
                                             {kHeader, "origin.tapes.id", is_id},
                                             {"half-close", "by", is_side},
                                             {"zero", "wall", is_moment},
                                             {"zero", "boot", is_boot},
                                             {"settings", "by", is_side},
                                             {"settings", "parity", is_parity},
                                             {"settings", "order", is_order},
                                             {"flush", "queue", is_queue},
                                             {"modem", "line", is_modem_line},
                                             {"modem", "state", is_state},
                                             {"modem", "by", is_side},
                                             {"break", "state", is_state},
                                             {"break", "by", is_side},
                                             {"fault", "kind", is_fault},
                                             {"fault", "dir", is_dir},
                                             {"end", "read.xxh3", is_digest},
                                             {"end", "write.xxh3", is_digest}});

template <class Kind>
bool is_name_of(std::string_view name) {
  if constexpr (std::is_same_v<Kind, event::Unknown>) {
    return false;
  } else {
    return name == Kind::kName;
  }
}
template <class... Kinds>
bool is_name_of_one(std::string_view name, const std::variant<Kinds...>*) {
  return (is_name_of<Kinds>(name) || ...);
}

}  // namespace

bool is_known_kind(std::string_view kind) { return is_name_of_one(kind, static_cast<const Event*>(nullptr)); }

bool is_known_key(std::string_view kind, std::string_view key) {
  return holds(kEveryEvent, key) || ((kind == kHeader || is_known_kind(kind)) && holds(kFormatKeys, key));
}

bool is_known_number(std::string_view kind, std::string_view key) {
  return key == "t_us" || ((kind == kHeader || is_known_kind(kind)) && holds(kFormatNumbers, key));
}

bool is_word(std::string_view kind, std::string_view path, std::string_view text) {
  if (path == "event" && kind != kHeader) return is_known_kind(text);
  return std::ranges::any_of(
      kWords, [&](const Word& word) { return word.kind == kind && word.path == path && word.is_word(text); });
}

}  // namespace porttape::event_words
