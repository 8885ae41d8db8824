#include "libport/session/connections.hpp"

#include <algorithm>
#include <exception>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {

Connections::Connections(const PortContext& context, std::unique_ptr<Port> driver,
                         std::unique_ptr<DeviceGroup> devices, std::function<void(int)> on_end,
                         EndLimits limits)
    : context_(context),
      limits_(limits),
      driver_(std::move(driver)),
      devices_(std::move(devices)),
      on_end_(std::move(on_end)),
      fence_(context.loop->fence()),
      end_timer_(*context.loop, [this] { give_up(); }) {
  driver_->listen(*this);
}

Connections::~Connections() = default;

Result<void> Connections::start() {
  ConnectionSource* const source = driver_->connections();
  if (source == nullptr)
    return make_error(Errc::usage, fmt::format("{} has one driver at a time", driver_->name()));
  if (Result<void> ready = devices_->prepare(); !ready) return ready;
  source->give_each([this](std::unique_ptr<Port> connection, const std::string& who) {
    connected(std::move(connection), who);
  });
  if (Result<void> ready = driver_->prepare(); !ready) return ready;
  driver_->open();
  return {};
}

void Connections::connected(std::unique_ptr<Port> connection, const std::string& who) {
  if (step_ != Step::running) return;
  if (const std::size_t most = driver_->connections()->most_connections(); lines_.size() >= most) {
    context_.log->warn("{}: {} is refused: {} connections are there, the most that max-connections allows",
                       driver_->name(), who, most);
    return;
  }
  const unsigned number = came_ + 1;
  context_.log->info("{}: connection {} is from {}", driver_->name(), number, who);
  if (Result<void> begun = begin(number, std::move(connection)); !begun) {
    context_.log->error("{}: connection {} of {} is refused: {}", driver_->name(), number, who,
                        begun.error().message);
    if (came_ == number) {  // else it is one too many
      ++before_.opens;
      if (exit_status_of(begun.error().code) == exit_status::kDevice) ++before_.device_losses;
      take(exit_status_of(begun.error().code));
      later([this] { end_if_over(); });
    }
  }
}

// Its callbacks run behind a fence of its own.
Result<void> Connections::begin(unsigned number, std::unique_ptr<Port> connection) {
  Result<std::unique_ptr<Port>> device = make_error(Errc::io, "");
  Line line{std::make_shared<Fence>(), nullptr};
  line.fence->on_exception = [this, number, alive = std::weak_ptr<int>(alive_)](const std::string& what) {
    if (!alive.expired()) threw(number, what);
  };
  PortContext context = context_;
  context.log = context_.log->clone(fmt::format("{} c{}", context_.log->name(), number));
  Result<void> begun;
  context_.loop->within(line.fence, [&] {
    try {
      device = devices_->port_for(number);
      if (!device) {
        begun = device.error();
        return;
      }
      came_ = number;
      line.session = std::make_unique<Session>(
          context, std::move(connection), std::move(*device),
          [this, number](int exit_status) { ended(number, exit_status); }, limits_);
      begun = line.session->start();
    } catch (const std::exception& error) {  // no thread, no descriptor, …
      begun = make_error(Errc::io, error.what());
    }
  });
  if (begun) lines_.emplace(number, std::move(line));
  return begun;
}

void Connections::ended(unsigned number, int exit_status) {
  context_.loop->within(fence_, [this, number, exit_status] {
    drop(number);
    take(exit_status);
    if (exit_status == exit_status::kRuntime && devices_->must_not_fail()) begin_end();
    end_if_over();
  });
}

void Connections::threw(unsigned number, const std::string& what) {
  context_.log->error("connection {} is ended: {}", number, what);
  context_.loop->within(fence_, [this, number] {
    later([this, number] {  // its parts are on the stack still
      if (!lines_.contains(number)) return;
      drop(number);
      take(exit_status::kRuntime);
      end_if_over();
    });
  });
}

void Connections::drop(unsigned number) {
  const auto line = lines_.find(number);
  before_ += line->second.session->counters();
  lines_.erase(line);
  context_.log->debug("connection {} has ended", number);
}

void Connections::take(int exit_status) {
  if (exit_status != exit_status::kDevice) exit_status_ = worse_exit_status(exit_status_, exit_status);
}

void Connections::end_if_over() {
  if (!lines_.empty()) return;
  const std::optional<unsigned> all = devices_->ends_after();
  if (step_ == Step::ending) {
    finish();
  } else if (step_ == Step::running && all && came_ >= *all) {
    begin_end();
  }
}

void Connections::stop() {
  if (step_ == Step::running) return begin_end();
  stop_lines();
  if (step_ == Step::finishing) end_timer_.set_after(limits_.at_once);
}

void Connections::begin_end() {
  if (step_ != Step::running) return;
  step_ = Step::ending;
  driver_->close();
  stop_lines();
  if (lines_.empty()) {
    later([this] { finish(); });
  }
}

// Each behind its own fence.
void Connections::stop_lines() {
  for (const auto& [number, line] : lines_) {
    Session& session = *line.session;
    context_.loop->within(line.fence, [&session] { session.stop(); });
  }
}

void Connections::finish() {
  if (step_ != Step::ending) return;
  step_ = Step::finishing;
  end_timer_.set_after(limits_.completing * std::max(1U, devices_->left_over(came_)));
  devices_->finish(came_, [this](int exit_status) {
    take(exit_status);
    driver_->finish();
  });
}

void Connections::give_up() {
  if (step_ != Step::finishing) return;
  context_.log->error("{}: what is to be completed at the end takes too long and is given up",
                      driver_->name());
  take(exit_status::kRuntime);
  complete();
}

void Connections::on_finished(int exit_status) {
  take(exit_status);
  later([this] { begin_end(); });
}

void Connections::on_complete(int) {
  if (step_ == Step::finishing) complete();
}

void Connections::complete() {
  step_ = Step::over;
  end_timer_.cancel();
  later([this] {
    // The callback may destroy this object, and with it the function.
    const auto on_end = std::move(on_end_);
    on_end(exit_status_);
  });
}

void Connections::later(std::function<void()> task) {
  context_.loop->post([task = std::move(task), alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) task();
  });
}

Result<void> Connections::request(const RecorderRequest& what) {
  devices_->request(what);
  return ask_all(what);
}

Result<void> Connections::request(const PlaybackRequest& what) { return ask_all(what); }

// Good where one of the lines takes it.
template <class Request>
Result<void> Connections::ask_all(const Request& what) {
  Result<void> all = make_error(Errc::usage, driver_->name() + ": no connection is there");
  bool taken = false;
  for (const auto& [number, line] : lines_) {
    Result<void> one = make_error(Errc::io, "the connection is ended");
    Session& session = *line.session;
    context_.loop->within(line.fence, [&] { one = session.request(what); });
    taken = taken || one;
    all = one;
  }
  return taken ? Result<void>() : all;
}

Channel::Counters Connections::counters() const {
  Counters all = before_;
  for (const auto& [number, line] : lines_) all += line.session->counters();
  return all;
}

std::vector<Session*> Connections::sessions() {
  std::vector<Session*> sessions;
  for (const auto& [number, line] : lines_) sessions.push_back(line.session.get());
  return sessions;
}

}  // namespace porttape
