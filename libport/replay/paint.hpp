#pragma once

#include <string>
#include <string_view>

namespace porttape {

// ANSI colours, or none. What they say is said by words and marks, too.
class Paint {
 public:
  explicit Paint(bool on) : on_(on) {}
  [[nodiscard]] std::string red(std::string_view text) const { return wrap("\033[31m", text); }
  [[nodiscard]] std::string green(std::string_view text) const { return wrap("\033[32m", text); }
  [[nodiscard]] std::string bold(std::string_view text) const { return wrap("\033[1m", text); }

 private:
  [[nodiscard]] std::string wrap(std::string_view code, std::string_view text) const {
    if (!on_ || text.empty()) return std::string(text);
    return std::string(code) + std::string(text) + "\033[0m";
  }
  bool on_;
};

}  // namespace porttape
