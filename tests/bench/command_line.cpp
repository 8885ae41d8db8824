#include <cstdio>
#include <utility>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/parsers.hpp>

#include "tests/bench/commands.hpp"
#include "tests/bench/line.hpp"

namespace porttape::bench {
namespace po = boost::program_options;

namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

std::string quoted(const std::string& value) {
  std::string json = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') json += '\\';
    json += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return json + '"';
}

}  // namespace

CommandLine::CommandLine(std::string usage, const std::string& positional) : usage_(std::move(usage)) {
  options_.add_options()("help,h", "this text");
  if (!positional.empty()) positional_.add(positional.c_str(), -1);
}

bool CommandLine::parse(const Arguments& arguments) {
  try {
    po::store(po::command_line_parser(arguments).options(options_).positional(positional_).run(), values_);
    if (has("help")) {
      std::string text = usage_ + "\n";
      std::fputs(text.c_str(), stdout);
      for (const auto& option : options_.options()) {
        std::printf("  %-28s %s\n", (option->format_name() + ' ' + option->format_parameter()).c_str(),
                    option->description().c_str());
      }
      return false;
    }
    po::notify(values_);
  } catch (const po::error& error) {
    throw UsageError(error.what());
  }
  return true;
}

JsonLine& JsonLine::raw(const std::string& key, const std::string& json) {
  if (text_.size() > 1) text_ += ',';
  text_ += quoted(key) + ':' + json;
  return *this;
}

JsonLine& JsonLine::add(const std::string& key, double value) { return raw(key, number(value)); }
JsonLine& JsonLine::add(const std::string& key, std::int64_t value) {
  return raw(key, std::to_string(value));
}
JsonLine& JsonLine::add(const std::string& key, std::uint64_t value) {
  return raw(key, std::to_string(value));
}
JsonLine& JsonLine::add(const std::string& key, const std::string& value) { return raw(key, quoted(value)); }

JsonLine& JsonLine::add(const std::string& key, const std::vector<double>& values) {
  std::string json = "[";
  for (const double value : values) json += (json.size() > 1 ? "," : "") + number(value);
  return raw(key, json + ']');
}

void JsonLine::print() const {
  std::printf("%s}\n", text_.c_str());
  std::fflush(stdout);
}

}  // namespace porttape::bench
