#pragma once

#include <optional>
#include <string>
#include <vector>

#include "libport/base/error.hpp"
#include "libport/tape/event.hpp"
#include "libport/tape/payload_totals.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// An r or w file as it is found.
struct HeldFile {
  std::string path;  // also where it does not exist
  bool exists = false;
  bool damaged = false;  // its blocks do not go on: told elsewhere, and not compared
  PayloadTotals totals{};
};

// What is wrong with a tape's files beside what its `end` tells of them (FORMAT.md, "Sound or not").
struct EndFindings {
  std::vector<std::string> damages;  // each with the file's name
  std::vector<std::string> notes;
};
// `end` tells of both; `events` is the name of the file in which it stands.
EndFindings compare_with_end(const HeldFile& read, const HeldFile& write, const event::End& end,
                             const std::string& events);

// Whether a recorder that wrote this header tells digests at the end.
bool has_digests(const std::optional<TapeHeader>& header);

// Holds what passes of a tape against what its `end` tells: pass() for each record, of each file in order,
// then flaw(). A tape that is being written is not to be checked. Owns no file.
class EndCheck {
 public:
  struct Names {
    std::string read;
    std::string write;
    std::string events;
    bool has_read = false;
    bool has_write = false;

    // Of a tape on the disk.
    static Names of(const TapePaths& tape);
  };

  EndCheck(Names names, const std::optional<TapeHeader>& header);

  void pass(const Record& record);
  // As if nothing had passed.
  void rewind();
  // Errc::damaged_tape. Nothing where the last event is no `end`, or tells nothing.
  [[nodiscard]] std::optional<Error> flaw() const;

 private:
  Names names_;
  bool with_digest_;
  PayloadCounter read_;
  PayloadCounter write_;
  std::optional<event::End> end_;  // the last event
};

}  // namespace porttape
