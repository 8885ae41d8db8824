#include "libport/tape/json_line.hpp"

#include <boost/json/parse.hpp>

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

}  // namespace porttape
