#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "libport/base/time.hpp"
#include "libport/line/line_event.hpp"
#include "libport/replay/lateness.hpp"
#include "libport/replay/report.hpp"

namespace porttape {

// The books of one run: what went over the line, the mismatches, how late we were; and the verdict that
// follows. A plain value; starts at the driver's first open.
class RunLedger {
 public:
  explicit RunLedger(Instant begun) : begun_(begun), last_byte_(begun) {}

  void delivered(std::size_t bytes) { to_driver_ += bytes; }
  // What the device did besides.
  void told(const LineEvent& event);
  // The driver's write, which begins at `offset` of its stream.
  void written(ByteView data, std::uint64_t offset);
  // Something went over the line, either way.
  void byte(Instant now) { last_byte_ = std::max(last_byte_, now); }
  // The driver has begun a further session.
  void session() { ++sessions_; }
  [[nodiscard]] std::uint64_t sessions() const { return sessions_; }
  // Tells where in the latest write it is, if it is in that.
  void place_in_write(Mismatch& mismatch) const;
  void lateness(Nanos late) {
    lateness_.add(late);
    last_late_ = late;
  }
  void mismatch(const Mismatch& mismatch);
  // Where the tape goes on after the first mismatch of data, if that is not told yet.
  void went_on(const std::string& where);
  void settings(SettingsReport report) { settings_ = std::move(report); }

  [[nodiscard]] Micros since_begin(Instant now) const;
  [[nodiscard]] Nanos last_lateness() const { return last_late_; }
  [[nodiscard]] std::uint64_t mismatches() const { return mismatches_; }

  // What of it was to happen and did not.
  struct Missing {
    bool unsent = false;    // recorded writes, or an end of them
    bool unplayed = false;  // a device ended before the tape had played its driver to the end
  };
  // What of the report the ledger knows.
  [[nodiscard]] RunReport report(const ReplayConfig& config, Instant now, Missing missing) const;

 private:
  Instant begun_;
  Instant last_byte_;
  std::uint64_t sessions_ = 1;
  std::uint64_t writes_ = 0;
  std::uint64_t write_begin_ = 0;  // of the latest, in the driver's stream
  std::uint64_t to_driver_ = 0;
  std::uint64_t from_driver_ = 0;
  std::map<std::string, std::uint64_t, std::less<>> told_;
  std::uint64_t mismatches_ = 0;
  std::optional<Mismatch> first_data_;  // or extra
  std::optional<Mismatch> first_timing_;
  SettingsReport settings_;
  LatenessHistogram lateness_;
  Nanos last_late_{0};
};

}  // namespace porttape
