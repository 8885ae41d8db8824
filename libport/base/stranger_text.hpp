#pragma once

#include <compare>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

namespace porttape {

// Free text that a stranger may have written: the marks, reasons, names and dates of a tape. Such a text may
// hold anything: a terminal's commands, markup, lines that look like a report's. It is never refused. Instead
// it is escaped for the place where it goes, and there is no way to print it without naming the place:
//
//   place                                          function       what it does
//   a line of a terminal, a log or a message       for_line()     printable_line()
//   the same, in single quotes                     in_quotes()    in_quotes()
//   lines of a terminal or a log                   for_lines()    printable_lines()
//   JSON: a string with its quotes                 for_json()     json_quote(); JsonObject::add() does it
//   XML (JUnit) and HTML and SVG: an element       for_element()  xml_text()
//   the same: an attribute's value                 for_attribute()
//   a shell line that a person may paste           for_shell()    shell_word()
//   another tape, a comparison, a search           raw()          nothing
//
// TAP and CMake get lines of the first kind. A new place gets a function, and a row, here.
//
// Values are made from any text: what porttape itself writes on a tape is somebody else's text for whoever
// reads it. A value may be copied and compared. Bytes that are not UTF-8 are kept, and escaped like the rest.
class StrangerText {
 public:
  StrangerText() = default;
  // NOLINTBEGIN(google-explicit-constructor): only the way out is to be named
  StrangerText(std::string text) : text_(std::move(text)) {}
  StrangerText(std::string_view text) : text_(text) {}
  StrangerText(const char* text) : text_(text) {}
  // NOLINTEND(google-explicit-constructor)

  [[nodiscard]] std::string for_line() const;
  [[nodiscard]] std::string for_lines() const;
  [[nodiscard]] std::string in_quotes() const;
  [[nodiscard]] std::string for_json() const;
  [[nodiscard]] std::string for_element() const;
  [[nodiscard]] std::string for_attribute() const;
  [[nodiscard]] std::string for_shell() const;
  [[nodiscard]] const std::string& raw() const { return text_; }

  [[nodiscard]] bool empty() const { return text_.empty(); }
  void clear() { text_.clear(); }

  friend auto operator<=>(const StrangerText&, const StrangerText&) = default;  // by bytes

 private:
  std::string text_;
};

}  // namespace porttape
