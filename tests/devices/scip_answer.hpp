#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

// SCIP 2.0, the protocol of many laser scanners: an answer taken apart, every checksum checked.
namespace scip {

struct WrongAnswer : std::runtime_error {
  using std::runtime_error::runtime_error;
};

inline char checksum(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) sum += static_cast<unsigned char>(c);
  return static_cast<char>((sum & 0x3FU) + 0x30U);
}

inline std::uint32_t decode(std::string_view text) {
  std::uint32_t value = 0;
  for (const char c : text) value = value << 6U | (static_cast<unsigned char>(c) - 0x30U);
  return value;
}

inline std::string_view checked(std::string_view line) {
  if (line.size() < 2 || checksum(line.substr(0, line.size() - 1)) != line.back()) {
    throw WrongAnswer("bad checksum in \"" + std::string(line) + '"');
  }
  return line.substr(0, line.size() - 1);
}

struct Answer {
  std::string status;
  std::vector<std::string> fields;      // "NAME:VALUE" of VV, PP and II
  std::uint32_t stamp = 0;              // ms, of GD and MD
  std::vector<std::uint32_t> readings;  // mm
};

// `lines`: what came up to the empty line that ends it, without the ends of line.
inline Answer parse(std::string_view command, const std::vector<std::string>& lines) {
  const bool streams = command.front() == 'M';  // the echo of each scan counts down
  const std::size_t same = streams ? command.size() - 2 : command.size();
  if (lines.size() < 2 || lines[0].substr(0, same) != command.substr(0, same)) {
    throw WrongAnswer("not an answer to " + std::string(command));
  }
  Answer answer;
  answer.status = checked(lines[1]);
  const bool scan = (command[0] == 'G' || streams) && command[1] == 'D';
  std::string data;
  for (std::size_t i = 2; i < lines.size(); ++i) {
    if (!scan) {
      const std::string_view line = lines[i];
      if (line.size() < 2 || line[line.size() - 2] != ';' ||
          checksum(line.substr(0, line.size() - 2)) != line.back()) {
        throw WrongAnswer("bad checksum in \"" + lines[i] + '"');
      }
      answer.fields.emplace_back(line.substr(0, line.size() - 2));
    } else if (i == 2) {
      answer.stamp = decode(checked(lines[i]));
    } else {
      data += checked(lines[i]);
    }
  }
  for (std::size_t at = 0; at + 3 <= data.size(); at += 3) {
    answer.readings.push_back(decode(std::string_view(data).substr(at, 3)));
  }
  return answer;
}

// How many answers a command has: streaming ones (MDbbbbeeeeccinn) one and nn more.
inline unsigned answers_to(std::string_view command) {
  if (command.front() != 'M' || command.size() < 15) return 1;
  return 1 + static_cast<unsigned>((command[13] - '0') * 10 + (command[14] - '0'));
}

// One line about it, and one a field.
inline std::string describe(std::string_view command, const Answer& answer) {
  std::string out = std::string(command) + ": status " + answer.status;
  if (!answer.readings.empty()) {
    std::uint64_t sum = 0;
    for (const std::uint32_t reading : answer.readings) sum += reading;
    out += ", " + std::to_string(answer.readings.size()) + " readings at " + std::to_string(answer.stamp) +
           " ms, mean " + std::to_string(sum / answer.readings.size()) + " mm";
  }
  out += '\n';
  for (const std::string& field : answer.fields) out += "  " + field + '\n';
  return out;
}

}  // namespace scip
