#pragma once

#include <string>
#include <string_view>

namespace porttape {

// Text as XML 1.0 has it in an element, with its lines, or in the value of an attribute, which has one line.
// What no XML holds, or a terminal would obey, is escaped.
std::string xml_text(std::string_view text, bool lines);

}  // namespace porttape
