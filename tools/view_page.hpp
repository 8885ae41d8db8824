#pragma once

#include <string>
#include <string_view>

// The page of `porttape view`: made of the files in tools/view by tools/view/embed.cmake.
namespace porttape {

extern const std::string_view kViewHtml;
extern const std::string_view kViewStyle;
extern const std::string_view kViewScript;
// SHA-256 in hex.
extern const std::string_view kViewStyleHash;
extern const std::string_view kViewScriptHash;

// What stands before the tapes' data, and behind it.
std::string view_page_head();
std::string view_page_tail();

}  // namespace porttape
