#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/line/waiting_events.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/session/channel.hpp"
#include "libport/session/last_bytes.hpp"
#include "libport/session/session_end.hpp"
#include "libport/session/session_news.hpp"

namespace porttape {

// Joins a driver's port and a device's port: the device is opened when a driver comes and closed when it
// goes, bytes are passed on at once, and who is slow stops the other side. Owns both ports.
//
// Drive it: start(), then the loop; stop() or a port's on_finished() leads to `on_end` with the exit status,
// once, from the loop. It must not be destroyed from within a callback of its ports; from `on_end` it may.
// Loop thread only.
//
// Its state is the device's, with whether a driver is there, and SessionEnd's step:
//
// | device      | what it means                       | driver is read     | leads out                    |
// |-------------|-------------------------------------|--------------------|------------------------------|
// | closed      | no driver, or the end               | none is there      | a driver comes: opening      |
// | opening     | open() was called, or is about to   | no                 | on_up: up                    |
// |             | be where it has just failed; a      |                    | on_down: down                |
// |             | passive one waits for its peer,     |                    | the driver goes: closed      |
// |             | maybe the next                      |                    |                              |
// | up          | bytes go both ways                  | unless the device  | on_interrupted: interrupted  |
// |             |                                     | is congested       | on_down: down; opening where |
// |             |                                     |                    | a passive one's peer closed  |
// |             |                                     |                    | the driver goes: closed, or  |
// |             |                                     |                    | draining if congested        |
// | interrupted | brings its line up again by itself  | no                 | on_resumed: up               |
// |             |                                     |                    | the rest as from up          |
// | down        | its line has ended, the driver's is | yes: what it sends | the driver goes: closed      |
// |             | hung up                             | reaches nobody     |                              |
// | draining    | the driver has gone, its last bytes | the next one: no   | drained, on_interrupted,     |
// |             | are on their way to the device      |                    | on_down, 30 s in which it    |
// |             |                                     |                    | takes none (where a next one |
// |             |                                     |                    | waits: in all): closed, then |
// |             |                                     |                    | opening if a driver is there |
//
// A driver whose port is not passive will not come back: its going begins the end, whatever the device's
// state. The device is read in every state, except while the driver is congested or interrupted; what it
// sends to no driver is counted and told. Once the end has begun no device is opened any more; from `sending`
// on the device is not read, and the driver only where the device has no line (closed, opening, down), where
// it has closed and what it left is for the device, and at its close.
class Session final : public Channel {
 public:
  using EndLimits = porttape::EndLimits;

  Session(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<Port> device,
          std::function<void(int exit_status)> on_end, EndLimits limits);
  Session(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<Port> device,
          std::function<void(int exit_status)> on_end)
      : Session(context, std::move(driver), std::move(device), std::move(on_end), EndLimits{}) {}
  ~Session() override;

  Result<void> start() override;
  void stop() override;
  Result<void> request(const RecorderRequest& what) override {
    Recorder* const recorder = device_->recorder();
    if (recorder == nullptr) return make_error(Errc::usage, device_->name() + " is not recorded");
    return recorder->request(what);
  }
  Result<void> request(const PlaybackRequest& what) override {
    Playback* const playback = device_->playback_control();
    if (playback == nullptr) return make_error(Errc::usage, device_->name() + " is no tape that is replayed");
    return playback->request(what);
  }

  // How it stands, for who asks from outside: `opening` the device for a driver that is there, `broken` where
  // the device's line has ended and the driver has yet to close.
  enum class State { waiting, opening, open, interrupted, broken, draining, ending };
  [[nodiscard]] State state() const;

  [[nodiscard]] Counters counters() const override;
  [[nodiscard]] std::vector<Session*> sessions() override { return {this}; }
  [[nodiscard]] Port& driver() override { return *driver_; }
  [[nodiscard]] Port& device() { return *device_; }

 private:
  enum class DeviceState { closed, opening, up, interrupted, down, draining };

  struct Gate;
  struct DriverSide;
  struct DeviceSide;

  void driver_up();
  void trace(std::string_view arrow, ByteView data) const;
  void driver_data(ByteView data);
  void driver_arrivals(ByteView data, std::span<const std::size_t> ends);
  PortListener::Answers driver_ended();
  PortListener::Answers device_ended();
  [[nodiscard]] bool wants_rest() const;
  bool take_rest();
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
  void device_waits();
  void open_device_now();
  void pass_early_state();
  [[nodiscard]] spdlog::level::level_enum about_driver() const;
  void finished(int exit_status);
  void on_drain_timer();
  void driver_told(const LineEvent& event);
  void driver_set(const line::Settings& settings);
  void device_told(const LineEvent& event);
  [[nodiscard]] bool waits_for_device(const LineEvent& event) const;
  void drop_early();
  void show_settings();
  void device_complete(int exit_status);
  void driver_complete();

  void open_device();
  void close_device();
  void begin_end();
  void continue_end();
  void on_end_timer();
  [[nodiscard]] bool device_opens_later() const;
  [[nodiscard]] bool device_has_line() const;
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
  SessionNews news_;
  Timer end_timer_;
  Timer drain_timer_;
  LastBytes last_bytes_;  // of a driver that has closed
  WaitingEvents early_;
  Timer open_timer_;   // for a device that has just failed
  Counters counters_;  // but for what was dropped
  int exit_status_ = 0;
  bool driver_up_ = false;
  bool driver_interrupted_ = false;  // it comes back by itself
  bool quiet_driver_ = false;        // it came while the device's line was failing
  bool refusal_told_ = false;        // of settings, in this session
  bool takes_rest_ = false;          // at the end: what a driver that has closed left is read
  DeviceState device_state_ = DeviceState::closed;
  SessionEnd end_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
