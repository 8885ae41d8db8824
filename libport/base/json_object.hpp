#pragma once

#include <concepts>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

#include "libport/base/json_text.hpp"

namespace porttape {

// Puts a JSON object together, members in the order they are added.
class JsonObject {
 public:
  JsonObject& add(std::string_view key, std::string_view text) { return add_raw(key, json_quote(text)); }
  template <std::integral Number>
  JsonObject& add(std::string_view key, Number number) {
    return add_raw(key, std::to_string(number));
  }
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

}  // namespace porttape
