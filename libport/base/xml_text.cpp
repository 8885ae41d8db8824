#include "libport/base/xml_text.hpp"

#include "libport/base/printable.hpp"
#include "libport/base/utf8.hpp"

namespace porttape {
namespace {

bool is_no_xml(char32_t character) { return character == 0xFFFE || character == 0xFFFF; }

void append_xml(std::string& out, std::string_view sequence, char32_t character) {
  switch (character) {
    case U'&':
      out += "&amp;";
      return;
    case U'<':
      out += "&lt;";
      return;
    case U'>':
      out += "&gt;";
      return;
    case U'"':
      out += "&quot;";
      return;
    default:
      out += is_obeyed(character) ? printable_line(sequence) : std::string(sequence);
  }
}

}  // namespace

std::string xml_text(std::string_view text, bool lines) {
  std::string out;
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const std::string_view sequence = text.substr(0, length == 0 ? 1 : length);
    text.remove_prefix(sequence.size());
    if (lines && (sequence == "\n" || sequence == "\t")) {
      out += sequence;
    } else if (lines && sequence == "\r" && text.starts_with('\n')) {
      continue;
    } else if (length == 0) {
      out += printable_line(sequence);
    } else if (const char32_t character = utf8_character(sequence); is_no_xml(character)) {
      out += character == 0xFFFE ? "\\u{fffe}" : "\\u{ffff}";
    } else {
      append_xml(out, sequence, character);
    }
  }
  return out;
}

}  // namespace porttape
