#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// One thing on a tape, which the recorded driver or the recorded device did.
struct TapeItem {
  enum class Kind : std::uint8_t {
    open,         // the driver opened its port
    close,        // and closed it
    read,         // the device sent `data`
    write,        // the driver wrote `data`
    settings,     // the driver set `baud`
    driver_ends,  // the driver ended its direction
    device_ends,  // the device ended its direction
    hang_up,      // the device broke the driver's line
    flush,        // the driver dropped what had come to it
    mark,         // a user's note
    gap           // the recorder lost `bytes` bytes
  };
  Kind kind = Kind::mark;
  Micros at{};
  Bytes data = {};
  unsigned baud = 0;
  std::uint64_t bytes = 0;

  [[nodiscard]] bool reads() const { return kind == Kind::read; }
  [[nodiscard]] bool writes() const { return kind == Kind::write; }
  // Neither side did it.
  [[nodiscard]] bool is_note() const { return kind == Kind::mark || kind == Kind::gap; }
};

// A frame that a rules file is about, at the beginning of what is written or read: a start, a number and
// more.
struct NumberedFrame {
  static constexpr std::size_t kSize = 8;
  static constexpr std::size_t kNumber = 3;  // where it stands, in two bytes

  // Whether it begins with one.
  static bool begins(ByteView data);
  // In the place of its first bytes. What is too short stays.
  static void put(Bytes& data);
};

// A tape by chance: what is on it, in order. It begins with an open, and each session ends with a close.
class TapeScript {
 public:
  struct Wanted {
    std::int64_t most_sessions = 1;
    bool half_closes = false;  // the driver's line has them
    bool only_bytes = false;   // besides opens and closes
    bool hang_ups = true;
    bool gaps = false;  // with bytes
    Micros longest_gap{300'000};
  };

  TapeScript() = default;
  TapeScript(World& world, const Wanted& wanted);

  // Puts a frame at the beginning of all that is long enough.
  void number();

  // Makes its files. `who`: for the trace.
  void write_tape(World& world, const std::string& name, const std::string& who) const;

  [[nodiscard]] const std::vector<TapeItem>& items() const { return items_; }
  // All that the device sent, and all that the driver wrote.
  [[nodiscard]] const Bytes& reads() const { return reads_; }
  [[nodiscard]] const Bytes& writes() const { return writes_; }
  [[nodiscard]] bool has(TapeItem::Kind kind) const;

 private:
  void add_session(World& world, const Wanted& wanted);
  void add(World& world, TapeItem item);

  std::vector<TapeItem> items_;
  Bytes reads_;
  Bytes writes_;
  Micros now_{};
  Micros longest_gap_{};
};

// For the trace and for messages.
std::string to_text(const TapeItem& item);

}  // namespace porttape::simulation
