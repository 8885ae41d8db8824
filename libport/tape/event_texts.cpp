#include "libport/tape/event_texts.hpp"

#include <algorithm>
#include <array>

#include <boost/json/serialize.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_text.hpp"
#include "libport/tape/json_line.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

// Texts of these keys are words of the format.
constexpr auto kWordKeys = std::to_array<std::string_view>(
    {"event",  "format",     "created",    "id",    "wall",  "boot", "transport", "stamped", "by",   "tool",
     "parity", "hwflowctrl", "swflowctrl", "order", "queue", "line", "state",     "dir",     "kind", "xxh3"});

// Whether something has changed.
bool change_in(json::value& value, const std::string& key, const TextChange& change) {
  bool changed = false;
  if (json::string* text = value.if_string()) {
    const std::string_view before(text->data(), text->size());
    const std::string after = to_utf8(change(key, before));
    changed = after != before;
    if (changed) text->assign(after.data(), after.size());
  } else if (json::array* list = value.if_array()) {
    for (json::value& item : *list) changed = change_in(item, key, change) || changed;
  } else if (json::object* object = value.if_object()) {
    for (auto& member : *object) {
      const std::string_view name(member.key().data(), member.key().size());
      const bool word = member.value().is_string() &&
                        std::find(kWordKeys.begin(), kWordKeys.end(), name) != kWordKeys.end();
      const std::string path = key.empty() ? std::string(name) : key + "." + std::string(name);
      if (!word) changed = change_in(member.value(), path, change) || changed;
    }
  }
  return changed;
}

}  // namespace

std::string change_texts(std::string_view line, const TextChange& change) {
  json::value value = parse_json_line(line);
  return change_in(value, "", change) ? json::serialize(value) : std::string(line);
}

std::string without_identity(std::string_view line) {
  json::value value = parse_json_line(line);
  json::object* object = value.if_object();
  if (object == nullptr) return std::string(line);
  std::size_t gone = object->erase("host") + object->erase("identity");
  if (json::value* zero = object->if_contains("zero"); zero != nullptr && zero->is_object())
    gone += zero->get_object().erase("boot");
  gone += object->erase("boot");
  return gone > 0 ? json::serialize(value) : std::string(line);
}

}  // namespace porttape
