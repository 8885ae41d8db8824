#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/timer.hpp"

namespace porttape {

// Joins a driver's port and a device's port: the device is opened when a driver comes and closed when it
// goes, bytes are passed on at once, and who is slow stops the other side. Owns both ports.
//
// Drive it: start(), then the loop; stop() or a port's on_finished() leads to `on_end` with the exit status,
// once, from the loop. It must not be destroyed from within a callback of its ports; from `on_end` it may.
// Loop thread only.
class Session {
 public:
  struct Counters {
    std::uint64_t to_driver_bytes = 0;
    std::uint64_t from_driver_bytes = 0;
    std::uint64_t dropped_bytes = 0;  // reached nobody: the other side was not there or did not take them
    std::uint64_t opens = 0;
  };

  Session(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<Port> device,
          std::function<void(int exit_status)> on_end);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Prepares both ports and waits for a driver. On an error nothing is left behind.
  Result<void> start();

  // Passes on what has come in, completes tape and report, ends. Called again: ends at once.
  void stop();

  // Starts the next tape.
  void rotate() { device_->rotate(); }

  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] Port& driver() { return *driver_; }
  [[nodiscard]] Port& device() { return *device_; }

 private:
  // Where the session stands on its way to the end.
  enum class Ending { no, sending, leaving, ended };

  struct Gate;
  struct DriverSide;
  struct DeviceSide;

  void driver_up();
  void driver_data(ByteView data);
  PortListener::Answers driver_ended();
  void let_driver(bool read);
  void let_device(bool read);
  bool keep_early(Gate& gate, const Port& port, ByteView data);
  void read_driver();
  void read_device();
  void driver_interrupted(const LineDown& down);
  void driver_down(const LineDown& down);
  void driver_gone(const LineDown& down);
  void device_up();
  void device_data(ByteView data);
  void device_arrivals(ByteView data, std::span<const std::size_t> ends);
  void device_interrupted(const LineDown& down);
  void device_resumed();
  void device_drained();
  void device_down(const LineDown& down);
  void dropped(std::uint64_t bytes, std::string_view why);
  void dropped_by_driver(std::uint64_t bytes, std::string_view why);
  void note_gap();
  void tell_dropped();
  void finished(int exit_status);
  void driver_flushed(FlushQueue queue);
  void device_complete(int exit_status);
  void driver_complete();

  void open_device();
  void close_device();
  void begin_end(bool limited);
  void continue_end();
  void end();

  PortContext context_;
  std::unique_ptr<DriverSide> driver_side_;
  std::unique_ptr<DeviceSide> device_side_;
  std::unique_ptr<Port> driver_;
  std::unique_ptr<Port> device_;
  std::function<void(int)> on_end_;
  Timer end_timer_;
  Timer drain_timer_;
  Counters counters_;
  bool taking_in_ = true;      // until the end: then what is there goes out, and no more comes in
  std::uint64_t dropped_ = 0;  // not told in the log yet
  std::string dropped_why_;
  std::uint64_t driver_dropped_ = 0;  // on the driver's side, not noted on the tape yet
  std::string driver_dropped_why_;
  int exit_status_ = 0;
  Ending ending_ = Ending::no;
  bool limited_ = false;  // the end waits for slow peers only so long
  bool driver_up_ = false;
  bool device_open_ = false;  // between device_->open() and device_->close()
  bool device_up_ = false;
  bool interrupted_ = false;     // the device brings its line up again by itself
  bool closing_device_ = false;  // the driver has gone, its last bytes are still on their way to the device
};

}  // namespace porttape
