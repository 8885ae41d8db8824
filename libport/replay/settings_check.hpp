#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/line/line_event.hpp"
#include "libport/replay/line_view.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What became of the driver's settings and signals that are on a tape.
struct SettingsReport {
  struct Missing {
    TapeTime at{};
    LineView what;

    friend bool operator==(const Missing&, const Missing&) = default;
  };
  static constexpr std::size_t kMostMissing = 64;

  std::uint64_t recorded = 0;    // that the driver had to make
  std::uint64_t made = 0;        // those of them that it did make
  std::vector<Missing> missing;  // the first of those that it did not

  friend bool operator==(const SettingsReport&, const SettingsReport&) = default;
};

// Whether a driver makes the settings, and changes the signals, that are recorded: in their order, with any
// others between them. The tape is told as the walk passes it, the driver's as they come; either may be ahead
// of the other. As many recorded ones as can be count as made.
//
// A recorded one has to be made where it changes the line in what the replaying one shows, and stood long
// enough to be seen for sure: for kSeenAfter, or until something that the driver wrote was answered. On a
// line that shows signals each is told, however short. It has to be made among the same writes. Where its
// order is not exact, on the tape or in the replay, it may have come anywhere from before the writes that
// were read with it to the close.
//
// A plain value, of bounded memory: far more on one side than on the other is compared piece by piece.
class SettingsCheck {
 public:
  // Shorter ones may fall between two looks at a pty.
  static constexpr Micros kSeenAfter{50'000};

  // A run begins, and the device's line is so, as far as known. `shows_signals`: the replaying line does.
  void begin(const SeenSettings& line, bool shows_signals = false);

  // The walk passes it; so many bytes of writes are before it. What is not `expected` nobody has to make.
  void pass(const Record& record, std::uint64_t writes, bool expected = true);
  // Something behind what was passed has reached the driver.
  void delivered() { delivered_ = taped_.size(); }
  // Where the driver's writes are on the tape, in bytes: those it has made, and those before the latest that
  // were read at once; and in which session of the run that is, from 1 on.
  struct Place {
    std::uint64_t written = 0;
    std::uint64_t before_latest = 0;
    std::uint64_t session = 0;
  };
  // The driver has made its line so, or changed a signal. Nothing: its place is not known.
  void made(const LineEvent& event, std::optional<Place> place = {});
  // It has closed its line.
  void closed(std::uint64_t written);

  // How far the driver came, and so what of the passed counts: what is before its last byte, that of so many
  // bytes of recorded writes; also what is before the last that reached it; or all.
  enum class Reach : std::uint8_t { written, delivered, all };
  // `sessions`: that the driver made. Where these are as many as the tape has so far, each belongs to the one
  // there.
  [[nodiscard]] SettingsReport report(Reach reach, std::uint64_t writes, std::uint64_t sessions = 0) const;

 private:
  // Between so many bytes of the tape's writes; anywhere, until that is known.
  struct Range {
    std::uint64_t from = 0;
    std::uint64_t to = std::numeric_limits<std::uint64_t>::max();
    bool ends_at_close = false;
    std::uint64_t session = 0;  // 0: in any

    static Range of(SettingsOrder order, const Place& place) {
      if (order == SettingsOrder::exact) return {place.written, place.written, false, place.session};
      return {.from = place.before_latest, .ends_at_close = true, .session = place.session};
    }
    void close(std::uint64_t written) {
      if (std::exchange(ends_at_close, false)) to = written;
    }
    [[nodiscard]] bool meets(const Range& other, bool by_session) const {
      const bool other_session = session != other.session && session > 0 && other.session > 0;
      return from <= other.to && other.from <= to && !(by_session && other_session);
    }
  };
  // A change on the tape.
  struct Taped {
    TapeTime at{};
    LineView what;
    bool by_driver = false;
    Range range{};
    std::uint64_t writes = 0;
    bool seen = true;  // stood long enough
  };
  struct Made {
    LineView what;
    Range range{};
  };
  struct Keys {
    bool baud = true, data_bits = false, parity = false, stop_bits = true, hw_flow = true, sw_flow = true;
    bool signals = false;

    void add(const SeenSettings& known);
    [[nodiscard]] LineView of(LineView line) const;
  };
  // The latest of the driver's on the tape: whether it is sure to be seen, or what is still to come for that.
  enum class Stand : std::uint8_t { sure, question, answer };
  struct Outcome {
    std::vector<std::size_t> required;  // the places in taped_ of those that have to be made
    std::vector<bool> made;             // which of them were
    std::size_t taped_end = 0;          // behind the last of them
    std::size_t made_end = 0;           // and in made_
  };

  void add_taped(const Taped& taped);
  void add_made(const Made& made);
  void end_latest(TapeTime at);
  // Of the first `end` of taped_.
  [[nodiscard]] std::vector<std::size_t> required(const Keys& keys, std::size_t end) const;
  [[nodiscard]] Outcome compare(std::size_t end, bool by_session) const;
  void add(const Outcome& outcome, std::size_t end, SettingsReport& to) const;
  void settle();

  LineView line_;  // before taped_
  std::vector<Taped> taped_;
  std::vector<Made> made_;
  bool shows_signals_ = false;
  std::optional<Keys> keys_;   // that the replaying line shows; nothing: it has shown none yet
  std::size_t delivered_ = 0;  // of taped_
  Stand stand_ = Stand::sure;
  std::uint64_t before_latest_ = 0;  // of the tape's writes, in this session
  std::uint64_t opens_ = 0;          // on the tape so far
  SettingsReport settled_;           // of what was compared and forgotten
};

}  // namespace porttape
