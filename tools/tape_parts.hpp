#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// A tape in memory, as parts that can be left out: exchanges (a run of writes and what is read up to the next
// write), and each block that is read before a first write. Opens, closes and what happens to the line belong
// to no part and stay, but for a session between two others in which nothing is left.
class TapeParts {
 public:
  static constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

  struct Part {
    Bytes request;           // empty: read before a first write
    std::uint64_t read = 0;  // bytes of the answer
  };

  // Errc::usage: no tape, or more than kMostBytes on it. Errc::damaged_tape.
  static Result<TapeParts> load(const TapePaths& tape);

  [[nodiscard]] const std::vector<Part>& parts() const { return parts_; }
  [[nodiscard]] std::uint64_t read_bytes() const { return read_bytes_; }

  // A new tape of these parts (ascending), with the times of what is left out taken out of it. Never replaces
  // one. Errc::usage, Errc::io.
  [[nodiscard]] Result<void> write(const TapePaths& tape, const std::vector<std::size_t>& kept,
                                   bool sync) const;

 private:
  struct Step {
    RecordKind kind;
    TapeTime at{};
    Bytes data;                       // of a block
    std::optional<Event> event;       // of all else,
    std::string line;                 // and as the tape has it
    std::optional<std::size_t> part;  // none: stays
  };

  [[nodiscard]] std::vector<const Step*> steps_of(const std::vector<std::size_t>& kept) const;

  std::optional<TapeHeader> header_;
  std::string name_;
  std::vector<Step> steps_;
  std::vector<Part> parts_;
  std::uint64_t read_bytes_ = 0;
};

}  // namespace porttape
