#pragma once

#include <cstdint>
#include <string_view>

#include <spdlog/spdlog.h>

#include "libport/base/time.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/session/drop_tally.hpp"
#include "libport/session/failures.hpp"

namespace porttape {

// Tells what goes wrong in a session: the log, of a device that fails and of bytes that reached nobody, all
// together where it comes again and again; and the device's tape, of the driver's bytes that are not on it.
// `context` and `device` must outlive it. Loop thread only.
class SessionNews {
 public:
  SessionNews(const PortContext& context, Port& device) : context_(context), device_(device) {}

  // The device's line is up (again).
  void up() { failures_.up(context_.loop->now()); }
  void device_failed(const LineDown& down, spdlog::level::level_enum level, std::string_view then = {});
  void device_works();
  // Of the device, as Failures has them.
  [[nodiscard]] Instant may_open() const { return failures_.may_open(); }
  [[nodiscard]] bool fails() const { return failures_.in_a_row(); }
  [[nodiscard]] bool fails_again() const { return failures_.repeats(); }

  // Of the device's, or of the driver's.
  void dropped(std::uint64_t bytes, std::string_view why);
  void dropped_by_driver(std::uint64_t bytes, std::string_view why);
  [[nodiscard]] std::uint64_t dropped_bytes() const { return dropped_bytes_; }
  // The driver's session is over, before the device is closed: one gap for it on the tape.
  void note_gap();
  // The driver's session is over: tells of what was dropped, unless the device fails again and again.
  void tell_dropped();
  // All that was not told yet.
  void end();

 private:
  void tell_failures();

  const PortContext& context_;
  Port& device_;
  Failures failures_;
  std::uint64_t dropped_bytes_ = 0;
  DropTally untold_;   // in the log
  DropTally unnoted_;  // on the tape
};

}  // namespace porttape
