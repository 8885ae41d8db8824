#pragma once

#include <map>
#include <string>
#include <vector>

#include "libport/tape/record.hpp"

namespace porttape {

// What holds on a tape's line: whether a driver has it open, its settings, the signals that are not as they
// are at an open, who has sent its last byte, a device that is lost. Told the tape's records in order. A
// plain value.
class LineState {
 public:
  void pass(const Record& record);

  // Whether an event says what holds already, whenever that was told.
  [[nodiscard]] bool holds(const Record& record) const;

  // The events that say it, as lines of an events file (without newlines): the open first.
  [[nodiscard]] std::vector<std::string> lines() const;

 private:
  void on_open(std::string_view line);
  void end_session();

  std::map<int, std::string> lines_;
};

}  // namespace porttape
