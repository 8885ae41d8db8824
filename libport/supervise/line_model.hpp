#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/line/line_signal.hpp"

namespace porttape {

// What a driver reads of modem lines where neither the device nor the tape has any.
struct LineDefaults {
  bool cts = true;
  bool dsr = true;
  bool cd = true;
  bool ri = false;
  bool loopback = false;  // as with a plug that leads RTS to CTS, and DTR to DSR and CD

  friend bool operator==(const LineDefaults&, const LineDefaults&) = default;
};

// `on` (CTS, DSR, CD on, RI off), `off`, `loopback`, or `cts=on,ri=off,…` of what is otherwise than `on`.
// Errc::usage.
Result<LineDefaults> parse_line_defaults(std::string_view text);

// The modem lines of one serial line, as its driver's side has them, and how often each changed. A plain
// value.
class LineModel {
 public:
  // Changes since the line was made, as TIOCGICOUNT counts them: RI only where it goes off.
  struct Counters {
    int cts = 0;
    int dsr = 0;
    int ri = 0;
    int cd = 0;
    int breaks = 0;

    friend bool operator==(const Counters&, const Counters&) = default;
  };

  LineModel() : LineModel(LineDefaults()) {}
  explicit LineModel(const LineDefaults& defaults);

  // A driver has opened the line, which raises DTR and RTS; the last has closed it.
  void opened();
  void closed();
  // The driver drives this one. True: it was otherwise.
  bool drive(LineSignal::Name name, bool on);
  // The device does. Once it has done so the defaults are of no use.
  void show(const LineSignal& signal);

  // As TIOCMGET has them.
  [[nodiscard]] int bits() const;
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  void set_input(LineSignal::Name name, bool on);
  void loop_back();

  bool dtr_ = false;
  bool rts_ = false;
  bool cts_;
  bool dsr_;
  bool cd_;
  bool ri_;
  bool loopback_;
  Counters counters_;
};

}  // namespace porttape
