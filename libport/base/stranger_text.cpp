#include "libport/base/stranger_text.hpp"

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/xml_text.hpp"

namespace porttape {

std::string StrangerText::for_line() const { return printable_line(text_); }
std::string StrangerText::for_lines() const { return printable_lines(text_); }
std::string StrangerText::in_quotes() const { return porttape::in_quotes(text_); }
std::string StrangerText::for_json() const { return json_quote(text_); }
std::string StrangerText::for_element() const { return xml_text(text_, true); }
std::string StrangerText::for_attribute() const { return xml_text(text_, false); }
std::string StrangerText::for_shell() const { return shell_word(text_); }

}  // namespace porttape
