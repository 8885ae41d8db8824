#include "tests/simulation/report_file.hpp"

#include <fstream>
#include <iterator>

#include <boost/json/parse.hpp>
#include <boost/system/error_code.hpp>

namespace porttape::simulation {

ReportFile::ReportFile(const std::filesystem::path& file) {
  std::ifstream stream(file);
  text_.assign(std::istreambuf_iterator<char>(stream), {});
  boost::system::error_code error;
  all_ = boost::json::parse(text_, error);
  if (error) all_ = nullptr;
}

const boost::json::value& ReportFile::at(std::string_view path) const {
  static const boost::json::value none;
  const boost::json::value* value = &all_;
  while (!path.empty()) {
    const std::string_view key = path.substr(0, path.find('.'));
    path.remove_prefix(std::min(path.size(), key.size() + 1));
    const auto* object = value->if_object();
    value = object == nullptr ? nullptr : object->if_contains(key);
    if (value == nullptr) return none;
  }
  return *value;
}

std::string ReportFile::word(std::string_view path) const {
  const auto* text = at(path).if_string();
  return text == nullptr ? std::string() : std::string(*text);
}

std::optional<std::int64_t> ReportFile::number(std::string_view path) const {
  const boost::json::value& value = at(path);
  if (const auto* whole = value.if_int64()) return *whole;
  if (const auto* whole = value.if_uint64()) return static_cast<std::int64_t>(*whole);
  return std::nullopt;
}

}  // namespace porttape::simulation
