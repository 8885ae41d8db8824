#include "libport/tape/event_words.hpp"

#include <algorithm>
#include <array>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "libport/tape/event_keys.hpp"

namespace porttape {
namespace {

using event_keys::Form;
using event_keys::Words;

constexpr auto kEveryEvent = std::to_array<std::string_view>({"t_us", "event", "carried"});

bool is_hex_of(std::string_view text, std::size_t digits) {
  return text.size() == digits && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

// '9' stands for a digit, 'f' for a hexadecimal one.
bool is_of_form(std::string_view text, std::string_view form) {
  return text.size() == form.size() && std::ranges::equal(text, form, [](char c, char wanted) {
           const bool digit = c >= '0' && c <= '9';
           if (wanted == '9') return digit;
           return wanted == 'f' ? digit || (c >= 'a' && c <= 'f') : c == wanted;
         });
}

// A key of a header or of a kind.
struct Key {
  std::string_view kind;
  std::string path;
  std::string_view name;  // the last part of the path
  bool is_number = false;
  Words words;  // that may stand there
  Form form = nullptr;

  [[nodiscard]] bool is_word(std::string_view text) const {
    return form != nullptr ? form(text) : std::ranges::find(words, text) != words.end();
  }
};

// Lists keys: see event_keys.hpp.
class KeyLister {
 public:
  KeyLister(std::string_view kind, std::string path, std::vector<Key>& keys)
      : kind_(kind), path_(std::move(path)), keys_(keys) {}

  void text(std::string_view name, const auto&) { add(name); }
  void text(std::string_view name, const auto&, Form form) { add(name, false, {}, form); }
  void text(std::string_view name, const auto&, Words words) { add(name, false, words); }
  template <class... Known>
  void text_if(std::string_view name, const auto& text, const Known&... known) {
    this->text(name, text, known...);
  }
  void word(std::string_view name, const auto&, Words words) { add(name, false, words); }
  template <class... Bounds>
  void number(std::string_view name, const auto&, Bounds...) {
    add(name, true);
  }
  void number_if(std::string_view name, std::uint64_t) { add(name, true); }
  void needed(std::string_view name, std::uint64_t) { add(name, true); }
  void flag(std::string_view name, const auto&) { add(name); }
  void moment(std::string_view name, const auto&) { add(name, true); }
  void digest(std::string_view name, const auto&) { add(name, false, {}, event_keys::is_digest); }
  void usb_id(std::string_view name, const auto&) { add(name); }
  template <class Value>
  void object(std::string_view name, const std::optional<Value>&) {
    add_inner<Value>(name);
  }
  template <class Value>
  void list(std::string_view name, const std::vector<Value>&) {
    add_inner<Value>(name);
  }
  void members(const auto& value) { event_keys::tell(value, *this); }

 private:
  void add(std::string_view name, bool is_number = false, Words words = {}, Form form = nullptr) {
    keys_.push_back({kind_, path_ + std::string(name), name, is_number, words, form});
  }
  template <class Value>
  void add_inner(std::string_view name) {
    add(name);
    KeyLister(kind_, path_ + std::string(name) + '.', keys_).members(Value{});
  }

  std::string_view kind_;
  std::string path_;  // before a key's name
  std::vector<Key>& keys_;
};

template <class... Kinds>
std::vector<Key> list_keys(std::type_identity<std::variant<event::Unknown, Kinds...>>) {
  std::vector<Key> keys;
  KeyLister header(event_words::kHeader, "", keys);
  header.text("format", std::string_view(), event_keys::kFormats);
  header.number("version", 0);
  header.members(TapeHeader{});
  (KeyLister(Kinds::kName, "", keys).members(Kinds{}), ...);
  return keys;
}

const std::vector<Key>& all_keys() {
  static const std::vector<Key> keys = list_keys(std::type_identity<Event>());
  return keys;
}

template <class... Kinds>
bool is_name_of_one(std::string_view name, std::type_identity<std::variant<event::Unknown, Kinds...>>) {
  return ((name == Kinds::kName) || ...);
}

bool is_of_format(std::string_view kind) {
  return kind == event_words::kHeader || event_words::is_known_kind(kind);
}

}  // namespace

namespace event_keys {

bool is_id(std::string_view text) { return is_hex_of(text, 32); }
bool is_digest(std::string_view text) { return is_hex_of(text, 16); }
bool is_wall_time(std::string_view text) {
  return is_of_form(text, "9999-99-99T99:99:99Z") || is_of_form(text, "9999-99-99T99:99:99.999999Z");
}
bool is_boot(std::string_view text) { return is_of_form(text, "ffffffff-ffff-ffff-ffff-ffffffffffff"); }

}  // namespace event_keys

namespace event_words {

bool is_known_kind(std::string_view kind) { return is_name_of_one(kind, std::type_identity<Event>()); }

bool is_known_key(std::string_view kind, std::string_view key) {
  return std::ranges::find(kEveryEvent, key) != kEveryEvent.end() ||
         (is_of_format(kind) && std::ranges::find(all_keys(), key, &Key::name) != all_keys().end());
}

bool is_known_number(std::string_view kind, std::string_view key) {
  return key == "t_us" || (is_of_format(kind) && std::ranges::any_of(all_keys(), [key](const Key& each) {
                             return each.is_number && each.name == key;
                           }));
}

bool is_word(std::string_view kind, std::string_view path, std::string_view text) {
  if (path == "event" && kind != kHeader) return is_known_kind(text);
  return std::ranges::any_of(all_keys(), [&](const Key& each) {
    return each.kind == kind && each.path == path && each.is_word(text);
  });
}

}  // namespace event_words
}  // namespace porttape
