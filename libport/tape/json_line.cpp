#include "libport/tape/json_line.hpp"

#include <boost/json/parse.hpp>
#include <boost/json/stream_parser.hpp>

namespace porttape {

namespace json = boost::json;

json::value parse_json_line(std::string_view line) {
  json::parse_options options;
  options.allow_invalid_utf8 = true;
  json::error_code failed;
  json::value value = json::parse({line.data(), line.size()}, failed, {}, options);
  if (failed || !value.is_object()) return nullptr;
  return value;
}

bool goes_on_behind_object(std::string_view text) {
  json::parse_options options;
  options.allow_invalid_utf8 = true;
  json::stream_parser parser({}, options);
  json::error_code failed;
  const std::size_t taken = parser.write_some(text.data(), text.size(), failed);
  return !failed && parser.done() && taken < text.size() && text[taken] != '\0';
}

}  // namespace porttape
