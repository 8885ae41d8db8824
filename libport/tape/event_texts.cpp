#include "libport/tape/event_texts.hpp"

#include <boost/json/serialize.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_text.hpp"
#include "libport/tape/event_words.hpp"
#include "libport/tape/json_line.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

std::string_view text_of_string(const json::string& text) { return {text.data(), text.size()}; }

// Goes through one line.
class TextChanger {
 public:
  TextChanger(std::string_view kind, const TextChange& change, const FixedLook& look)
      : kind_(kind), change_(change), look_(look) {}

  // Whether something has changed. `key` is the last part of `path`.
  bool change_in(json::value& value, std::string_view key, const std::string& path) {
    bool changed = false;
    if (json::string* text = value.if_string()) return change_text(*text, path);
    if (json::array* list = value.if_array()) {
      for (json::value& item : *list) changed = change_in(item, key, path) || changed;
    } else if (json::object* object = value.if_object()) {
      for (auto& member : *object) {
        const std::string_view name(member.key().data(), member.key().size());
        const std::string inner = path.empty() ? std::string(name) : path + "." + std::string(name);
        if (!event_words::is_known_key(kind_, name)) look(FixedText::key, path, name);
        changed = change_in(member.value(), name, inner) || changed;
      }
    } else if (value.is_number() && !event_words::is_known_number(kind_, key)) {
      look(FixedText::number, path, json::serialize(value));
    }
    return changed;
  }

 private:
  bool change_text(json::string& text, const std::string& path) {
    const std::string_view before = text_of_string(text);
    if (event_words::is_word(kind_, path, before)) return false;
    if (path == "event" && kind_ != event_words::kHeader) {
      look(FixedText::kind, path, before);
      return false;
    }
    const std::string after = to_utf8(change_(path, before));
    if (after == before) return false;
    text.assign(after.data(), after.size());
    return true;
  }
  void look(FixedText what, std::string_view path, std::string_view text) const {
    if (look_) look_(what, path, text);
  }

  std::string_view kind_;
  const TextChange& change_;
  const FixedLook& look_;
};

void visit_texts(const json::value& value, const std::function<void(std::string_view)>& visit) {
  if (const json::string* text = value.if_string()) {
    visit(text_of_string(*text));
  } else if (const json::array* list = value.if_array()) {
    for (const json::value& item : *list) visit_texts(item, visit);
  } else if (const json::object* object = value.if_object()) {
    for (const auto& member : *object) visit_texts(member.value(), visit);
  }
}

// Of an event; kHeader of a header.
std::string kind_of_line(const json::value& line) {
  const json::object* object = line.if_object();
  const json::value* kind = object == nullptr ? nullptr : object->if_contains("event");
  if (kind == nullptr || !kind->is_string()) return std::string(event_words::kHeader);
  return std::string(text_of_string(kind->get_string()));
}

}  // namespace

std::string change_texts(std::string_view line, const TextChange& change, const FixedLook& look) {
  json::value value = parse_json_line(line);
  const std::string kind = kind_of_line(value);
  return TextChanger(kind, change, look).change_in(value, "", "") ? json::serialize(value)
                                                                  : std::string(line);
}

void each_text(std::string_view line, const std::function<void(std::string_view text)>& visit) {
  visit_texts(parse_json_line(line), visit);
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
