#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/session/end_wait.hpp"

namespace porttape {

// Joins a driver's port and a device's port: the device is opened when a driver comes and closed when it
// goes, bytes are passed on at once, and who is slow stops the other side. Owns both ports.
//
// Drive it: start(), then the loop; stop() or a port's on_finished() leads to `on_end` with the exit status,
// once, from the loop. It must not be destroyed from within a callback of its ports; from `on_end` it may.
// Loop thread only.
//
// The end, in this order, each step bounded by EndLimits:
//   sending     nothing more is taken in; what was taken in goes out
//   leaving     the driver's line is hung up once the driver has read everything
//   completing  both ports are closed; tape and report are completed
// What a step gave up is counted and told.
class Session {
 public:
  struct Counters {
    std::uint64_t to_driver_bytes = 0;
    std::uint64_t from_driver_bytes = 0;
    std::uint64_t dropped_bytes = 0;  // reached nobody: the other side was not there or did not take them
    std::uint64_t opens = 0;
  };

  struct EndLimits {
    Nanos without_progress = std::chrono::seconds(5);      // sending and leaving together, see EndWait
    Nanos completing = std::chrono::milliseconds(10'500);  // a port gives a disk 10 s, and tells its loss
    Nanos failed_step = std::chrono::milliseconds(900);    // in all, where a port asked for a failed end
    Nanos at_once = std::chrono::milliseconds(500);        // completing, after a second stop()
  };

  Session(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<Port> device,
          std::function<void(int exit_status)> on_end, EndLimits limits);
  Session(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<Port> device,
          std::function<void(int exit_status)> on_end)
      : Session(context, std::move(driver), std::move(device), std::move(on_end), EndLimits{}) {}
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Prepares both ports and waits for a driver. On an error nothing is left behind.
  Result<void> start();

  // Passes on what has come in, completes tape and report, ends. Called again: ends at once.
  void stop();

  // Starts the next tape.
  void rotate() {
    if (Recorder* recorder = device_->recorder()) recorder->rotate();
  }

  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] Port& driver() { return *driver_; }
  [[nodiscard]] Port& device() { return *device_; }

 private:
  // Where the session stands on its way to the end.
  enum class Ending { no, sending, leaving, completing, ended };

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
  void begin_end();
  void continue_end();
  void on_end_timer();
  [[nodiscard]] std::optional<std::size_t> left() const;
  void end();
  void give_up_left();
  void complete();

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
  EndLimits limits_;
  Ending ending_ = Ending::no;
  std::optional<EndWait> end_wait_;
  bool failed_ = false;   // a port asked for the end with exit_status::kRuntime
  bool stopped_ = false;  // by stop()
  bool driver_up_ = false;
  bool device_open_ = false;  // between device_->open() and device_->close()
  bool device_up_ = false;
  bool interrupted_ = false;     // the device brings its line up again by itself
  bool closing_device_ = false;  // the driver has gone, its last bytes are still on their way to the device
};

}  // namespace porttape
