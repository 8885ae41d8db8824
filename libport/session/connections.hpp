#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "libport/catalog/device_group.hpp"
#include "libport/loop/fence.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/session/channel.hpp"
#include "libport/session/session.hpp"

namespace porttape {

// A Session for each connection to the driver's port, with a device's port of its own. They are numbered as
// they come, and freed when they have ended. What goes wrong in one stays in it: a device that does not
// answer is told and costs that connection, an exception ends it.
//
// It ends by stop(), by a tape that must not fail, or with the last connection of a group that is played
// once. The exit status is the worst of the sessions', without those whose device was missing or lost: the
// next connection may find it, as the next driver would. Tapes that nobody came for count too.
class Connections final : public Channel, private PortListener {
 public:
  Connections(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<DeviceGroup> devices,
              std::function<void(int exit_status)> on_end, EndLimits limits);
  Connections(const PortContext& context, std::unique_ptr<Port> driver, std::unique_ptr<DeviceGroup> devices,
              std::function<void(int exit_status)> on_end)
      : Connections(context, std::move(driver), std::move(devices), std::move(on_end), EndLimits{}) {}
  ~Connections() override;

  // Errc::usage: the driver's port gives no connections away.
  Result<void> start() override;
  void stop() override;
  Result<void> request(const RecorderRequest& what) override;
  Result<void> request(const PlaybackRequest& what) override;
  [[nodiscard]] Counters counters() const override;
  [[nodiscard]] Port& driver() override { return *driver_; }
  [[nodiscard]] std::vector<Session*> sessions() override;

 private:
  struct Line {
    std::shared_ptr<Fence> fence;
    std::unique_ptr<Session> session;
  };

  template <class Request>
  Result<void> ask_all(const Request& what);
  void connected(std::unique_ptr<Port> connection, const std::string& who);
  Result<void> begin(unsigned number, std::unique_ptr<Port> connection);
  void ended(unsigned number, int exit_status);
  void threw(unsigned number, const std::string& what);
  void drop(unsigned number);
  void take(int exit_status);
  void end_if_over();
  void begin_end();
  void stop_lines();
  void finish();
  void give_up();
  void complete();
  void later(std::function<void()> task);

  void on_up() override {}
  void on_data(ByteView) override {}
  void on_drained() override {}
  void on_down(const LineDown&) override {}
  void on_finished(int exit_status) override;
  void on_complete(int exit_status) override;

  PortContext context_;
  const EndLimits limits_;
  std::unique_ptr<Port> driver_;
  std::unique_ptr<DeviceGroup> devices_;
  std::function<void(int)> on_end_;
  std::shared_ptr<Fence> fence_;  // of the channel
  std::map<unsigned, Line> lines_;
  unsigned came_ = 0;  // the last connection's number
  Counters before_;    // of those that have ended
  Timer end_timer_;
  int exit_status_ = exit_status::kPass;
  enum class Step { running, ending, finishing, over } step_ = Step::running;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace porttape
