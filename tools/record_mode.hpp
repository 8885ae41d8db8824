#pragma once

#include <map>
#include <ostream>
#include <string>

#include "libport/base/result.hpp"
#include "libport/port/port_type.hpp"

namespace porttape {

// What `record` and `test` do with a tape that is not there (--record-mode). `new` and `all` are reserved.
enum class RecordMode {
  none,  // nothing is recorded, and no device's port is made
  once   // a tape that is missing is recorded, one that is there is played
};

OptionSpec record_mode_option();

// What a command line with --record-mode asks for.
struct Cassette {
  bool records = false;  // else it plays
  std::string note;      // to be told, or empty
};

// Whether the tape of these options is to be recorded. Under CI (environment) nothing ever is. Errc::usage: a
// mode that there is not, a tape that is missing and is not to be recorded, no device to record it from.
Result<Cassette> choose_cassette(const std::map<std::string, std::string>& values);

// The values that are left for the one and for the other verb.
std::map<std::string, std::string> values_to_record(std::map<std::string, std::string> values);
std::map<std::string, std::string> values_to_play(std::map<std::string, std::string> values);

}  // namespace porttape
