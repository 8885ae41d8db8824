#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include <boost/json/value.hpp>

namespace porttape::simulation {

// A replay's report as its user finds it in the file. A value's path is written with dots: `to_driver.bytes`.
class ReportFile {
 public:
  explicit ReportFile(const std::filesystem::path& file);

  // Whether the file holds a JSON object.
  [[nodiscard]] bool is_there() const { return all_.is_object(); }
  [[nodiscard]] const std::string& text() const { return text_; }
  [[nodiscard]] std::string verdict() const { return word("verdict"); }
  // Empty if there is no such text.
  [[nodiscard]] std::string word(std::string_view path) const;
  // Nullopt if there is no such number.
  [[nodiscard]] std::optional<std::int64_t> number(std::string_view path) const;
  // Null if there is no such value.
  [[nodiscard]] const boost::json::value& at(std::string_view path) const;

 private:
  std::string text_;
  boost::json::value all_;
};

}  // namespace porttape::simulation
