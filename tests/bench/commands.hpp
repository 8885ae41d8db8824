#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <boost/program_options/options_description.hpp>
#include <boost/program_options/positional_options.hpp>
#include <boost/program_options/variables_map.hpp>

namespace porttape::bench {

using Arguments = std::vector<std::string>;

// One subcommand's command line.
class CommandLine {
 public:
  // `usage` is what --help shows above the options, with an example.
  CommandLine(std::string usage, const std::string& positional = "");

  boost::program_options::options_description_easy_init option() { return options_.add_options(); }
  // False when --help was asked for and printed.
  bool parse(const Arguments& arguments);

  template <class T>
  [[nodiscard]] T get(const std::string& name) const {
    return values_[name].as<T>();
  }
  [[nodiscard]] bool has(const std::string& name) const { return values_.count(name) > 0; }
  [[nodiscard]] Arguments list(const std::string& name) const {
    return has(name) ? get<Arguments>(name) : Arguments{};
  }

 private:
  std::string usage_;
  boost::program_options::options_description options_{"Options"};
  boost::program_options::positional_options_description positional_;
  boost::program_options::variables_map values_;
};

// Prints one JSON object on a line of its own.
class JsonLine {
 public:
  JsonLine& add(const std::string& key, double value);
  JsonLine& add(const std::string& key, std::int64_t value);
  JsonLine& add(const std::string& key, std::uint64_t value);
  JsonLine& add(const std::string& key, const std::string& value);
  JsonLine& add(const std::string& key, const std::vector<double>& values);
  void print() const;

 private:
  JsonLine& raw(const std::string& key, const std::string& json);
  std::string text_ = "{";
};

// The subcommands; each returns an exit status.
int rtt_command(const Arguments& arguments);
int calls_command(const Arguments& arguments);
int drive_command(const Arguments& arguments);
int throughput_command(const Arguments& arguments);
int arrivals_command(const Arguments& arguments);
int channels_command(const Arguments& arguments);
int ptys_command(const Arguments& arguments);
int idle_command(const Arguments& arguments);
int peak_command(const Arguments& arguments);
int echo_command(const Arguments& arguments);
int flood_command(const Arguments& arguments);
int sink_command(const Arguments& arguments);
int make_tape_command(const Arguments& arguments);
int read_command(const Arguments& arguments);

}  // namespace porttape::bench
