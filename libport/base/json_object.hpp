#pragma once

#include <array>
#include <charconv>
#include <cmath>
#include <concepts>
#include <optional>
#include <string>
#include <string_view>

#include "libport/base/json_text.hpp"
#include "libport/base/stranger_text.hpp"

namespace porttape {

class JsonList;

// Puts a JSON object together, members in the order they are added. Numbers have one form, whatever the
// locale.
class JsonObject {
 public:
  JsonObject& add(std::string_view key, std::string_view text) { return add_raw(key, json_quote(text)); }
  template <std::same_as<StrangerText> Text>
  JsonObject& add(std::string_view key, const Text& text) {
    return add_raw(key, text.for_json());
  }
  template <std::integral Number>
  JsonObject& add(std::string_view key, Number number) {
    return add_raw(key, std::to_string(number));
  }
  // The shortest text that gives the same number; 0 for what JSON has no number for.
  JsonObject& add(std::string_view key, double number) {
    std::array<char, 40> text{};
    const auto end = std::to_chars(text.data(), text.data() + text.size(), number).ptr;
    return add_raw(key, std::isfinite(number) ? std::string_view(text.data(), end) : "0");
  }
  JsonObject& add(std::string_view key, const JsonObject& object) { return add_raw(key, object.str()); }
  inline JsonObject& add(std::string_view key, const JsonList& list);
  // `json` is JSON already.
  JsonObject& add_raw(std::string_view key, std::string_view json) {
    text_ += text_.empty() ? '{' : ',';
    text_ += json_quote(key);
    text_ += ':';
    text_ += json;
    return *this;
  }
  template <class Value>
  JsonObject& add_or_null(std::string_view key, const std::optional<Value>& value) {
    return value ? add(key, *value) : add_raw(key, "null");
  }

  [[nodiscard]] std::string str() const { return text_.empty() ? "{}" : text_ + '}'; }

 private:
  std::string text_;
};

// The same for a list.
class JsonList {
 public:
  JsonList& add(std::string_view text) { return add_raw(json_quote(text)); }
  JsonList& add(const JsonObject& object) { return add_raw(object.str()); }
  JsonList& add_raw(std::string_view json) {
    text_ += text_.empty() ? '[' : ',';
    text_ += json;
    return *this;
  }

  [[nodiscard]] std::string str() const { return text_.empty() ? "[]" : text_ + ']'; }

 private:
  std::string text_;
};

JsonObject& JsonObject::add(std::string_view key, const JsonList& list) { return add_raw(key, list.str()); }

}  // namespace porttape
