#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// A part of a tape that is played as if it were the whole: one of its sessions, from its open to its close
// (or to the next open, or to the tape's end), or all, up to a time. A plain value.
struct TapePart {
  std::uint64_t session = 0;      // 1-based, counted by opens; 0: the whole tape
  TapeTime from{};                // when it begins on the tape: zero of the part
  TapeTime to = TapeTime::max();  // when it ends, not included

  TapeTime until = TapeTime::max();  // where it is over at the latest, by the part's time

  [[nodiscard]] bool whole() const { return session == 0 && until == TapeTime::max(); }
  // A time of the tape as the part counts it.
  [[nodiscard]] TapeTime shifted(TapeTime at) const { return at - (from - TapeTime{}); }
};

// Finds one session on a tape by its events, told in order.
class SessionSearch {
 public:
  explicit SessionSearch(std::uint64_t session) { part_.session = session; }

  void on_open(TapeTime at);
  void on_close(TapeTime at);
  // Whether what comes now belongs to it.
  [[nodiscard]] bool inside() const { return part_.session == 0 || (opens_ == part_.session && !closed_); }
  [[nodiscard]] std::uint64_t opens() const { return opens_; }
  // Once all is told; nothing where there are not so many. A tape without opens is one session.
  [[nodiscard]] std::optional<TapePart> found() const;

 private:
  TapePart part_;
  std::uint64_t opens_ = 0;
  bool closed_ = false;
};

// The records of a part, times and offsets counted from its beginning. What precedes it comes as notes that
// have their bytes still, so that a Budget sees what reading over them costs; the end of the part is the end.
// Works on the merged tape and on one that is read in one direction alone. Refers to its source.
class PartOfTape final : public RecordSource {
 public:
  PartOfTape(RecordSource& source, const TapePart& part) : source_(source), part_(part) {}

  Result<std::optional<Record>> next() override;
  Result<void> rewind() override;

 private:
  enum class Place : std::uint8_t { before, inside, behind };
  Place place_of(const Record& record);
  Place place_of_event(RecordKind kind);

  RecordSource& source_;
  TapePart part_;
  std::uint64_t opens_ = 0;
  bool closed_ = false;
  std::uint64_t reads_before_ = 0;  // bytes
  std::uint64_t writes_before_ = 0;
  bool over_ = false;
};

}  // namespace porttape
