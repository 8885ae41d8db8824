#include "libport/catalog/device_group.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/catalog/port_types.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

// Wants to know nothing.
class Nobody : public PortListener {
 public:
  void on_up() override {}
  void on_data(ByteView) override {}
  void on_drained() override {}
  void on_down(const LineDown&) override {}
  void on_finished(int) override {}
  void on_complete(int) override {}

 protected:
  ~Nobody() = default;
};

// Whether the port can be used, without opening it.
Result<void> try_out(const Result<std::unique_ptr<Port>>& port, PortListener& listener) {
  if (!port) return port.error();
  (*port)->listen(listener);
  return (*port)->prepare();
}

// Devices that are there, with or without tapes.
class LiveDevices final : public DeviceGroup, private Nobody {
 public:
  LiveDevices(const PortContext& context, const PortSpec& device, std::string driver)
      : context_(context), device_(device), driver_(std::move(driver)) {
    const RecordingOptions* const recording = device_.get<RecordingOptions>();
    if (recording != nullptr)
      group_ = std::make_shared<TapeGroup>(recording->tape, recording->on_existing, context.loop->clock());
  }

  Result<void> prepare() override {
    if (group_) {
      if (Result<void> good = group_->check(); !good) return good;
    }
    PortSpec probe = spec_for(1);
    if (const RecordingOptions* const recording = probe.get<RecordingOptions>()) {
      PortSpec plain = recording->inner;
      probe = std::move(plain);
    }
    probe.common().always_open = false;  // which would connect
    return try_out(make_port(context_, probe, driver_), *this);
  }

  Result<std::unique_ptr<Port>> port_for(unsigned connection) override {
    return make_port(context_, spec_for(connection), driver_);
  }
  void request(const RecorderRequest& what) override {
    if (!what.note && group_) group_->rotate(context_.loop->now());
  }
  void finish(unsigned, std::function<void(int)> done) override { done(exit_status::kPass); }
  [[nodiscard]] bool must_not_fail() const override {
    const RecordingOptions* const recording = device_.get<RecordingOptions>();
    return recording != nullptr && recording->fail_closed;
  }

 private:
  [[nodiscard]] PortSpec spec_for(unsigned connection) const {
    PortSpec spec = device_;
    if (const RecordingOptions* const recording = device_.get<RecordingOptions>()) {
      RecordingOptions own = *recording;
      own.tape = group_->tape_of(connection);
      own.group = group_;
      own.connection = connection;
      spec.set(std::move(own));
    }
    return spec;
  }

  PortContext context_;
  PortSpec device_;
  std::string driver_;
  std::shared_ptr<TapeGroup> group_;  // null: nothing is recorded
};

// The tapes of a group in the devices' place.
class TapedDevices final : public DeviceGroup, private Nobody {
 public:
  TapedDevices(const PortContext& context, const PortSpec& device, std::string driver)
      : context_(context), device_(device), driver_(std::move(driver)) {}

  Result<void> prepare() override {
    tapes_ = tapes_of_group(options().tape);
    if (tapes_.empty()) tapes_.push_back(options().tape);  // it says what is wrong
    std::optional<TapeZero> zero;
    for (unsigned connection = 1; connection <= tapes_.size(); ++connection) {
      if (Result<void> good = check_tape(connection, zero); !good) return good;
    }
    context_.log->info("{} has {}", tapes_.front().name(), what_it_has());
    note_missing();
    return {};
  }

  Result<std::unique_ptr<Port>> port_for(unsigned connection) override {
    if (connection > tapes_.size()) {
      note_extra(connection);
      return make_error(
          Errc::usage,
          fmt::format("{} has {}, and this is number {}; start again to play {} again", tapes_.front().name(),
                      what_it_has(), connection, tapes_.size() == 1 ? "it" : "them"));
    }
    PortSpec spec = device_;
    ReplayOptions own = options();
    own.tape = tapes_[connection - 1];
    own.connection = connection;
    own.group = reports_;
    spec.set(std::move(own));
    return make_port(context_, spec, driver_);
  }

  // One tape after the other, since there may be more of them than descriptors.
  void finish(unsigned came, std::function<void(int)> done) override {
    next_ = came + 1;
    done_ = std::move(done);
    finish_next();
  }

  [[nodiscard]] unsigned left_over(unsigned came) const override {
    return static_cast<unsigned>(tapes_.size()) - std::min(came, static_cast<unsigned>(tapes_.size()));
  }
  [[nodiscard]] std::optional<unsigned> ends_after() const override {
    const bool ends = options().once || options().config.at_end == AtEnd::exit;
    return ends ? std::optional(static_cast<unsigned>(tapes_.size())) : std::nullopt;
  }

 private:
  [[nodiscard]] std::string what_it_has() const {
    return tapes_.size() == 1 ? "the tape of 1 connection"
                              : fmt::format("the tapes of {} connections", tapes_.size());
  }
  [[nodiscard]] const ReplayOptions& options() const { return *device_.get<ReplayOptions>(); }

  // The next run's report has it, or the last one's once more.
  void note_extra(unsigned connection) {
    reports_->doubts.push_back(
        {Doubt::Kind::refused, fmt::format("connection {} came and was turned away, since {} {} recorded: "
                                           "what it had to say is on no tape",
                                           connection, tapes_.size(), tapes_.size() == 1 ? "was" : "were")});
  }

  // Where a connection has no tape, those behind it meet the tapes of later ones. It had gone before this
  // part began, or its tape was lost: which nobody knows.
  void note_missing() {
    const std::vector<unsigned> recorded = recorded_connections(options().tape);
    for (unsigned number = 1; number <= recorded.size(); ++number) {
      if (recorded[number - 1] == number) continue;
      reports_->doubts.push_back(
          {Doubt::Kind::gap,
           fmt::format("connection {} has no tape {}: the one that came as number {} met the "
                       "tape of connection {}",
                       number, connection_tape(options().tape, number).name(), number,
                       recorded[number - 1])});
      return context_.log->warn("{}", reports_->doubts.back().text);
    }
  }

  // That it can be played, and is of the first one's recording.
  Result<void> check_tape(unsigned connection, std::optional<TapeZero>& zero) {
    const TapePaths& tape = tapes_[connection - 1];
    const Result<TapeReader> reader = TapeReader::open(tape);
    if (!reader) return reader.error();
    const auto& header = reader->header();
    if (header && header->zero) {
      const bool other =
          zero && !zero->boot.empty() &&
          (zero->boot != header->zero->boot || zero->monotonic_us != header->zero->monotonic_us);
      if (other) {
        return make_error(Errc::usage,
                          fmt::format("the tape {} is of another recording than {}; move it out of the way",
                                      tape.name(), tapes_.front().name()));
      }
      if (!zero) zero = header->zero;
    }
    return try_out(port_for(connection), *this);
  }

  void finish_next() {
    if (next_ > tapes_.size()) return finish_reports();
    context_.log->warn("no connection came for the tape {}", tapes_[next_ - 1].name());
    Result<std::unique_ptr<Port>> port = port_for(next_++);
    if (const Result<void> ready = try_out(port, *this); !ready) {
      context_.log->error("{}", ready.error().message);
      return on_complete(exit_status_of(ready.error().code));
    }
    port_ = std::move(*port);
    port_->finish();
  }

  // With what came to be known after the last run.
  void finish_reports() {
    if (late_ || reports_->doubts.empty() || !reports_->runs.latest()) return end(true);
    const auto publish = [this](const RunReport& report) {
      if (options().on_report) options().on_report(report);
    };
    ReplayReports::Options own{.tape = tapes_.front(),
                               .file = options().report_file,
                               .junit_file = options().junit_file,
                               .totals = {},
                               .group = reports_};
    late_ = std::make_unique<ReplayReports>(context_, std::move(own), publish);
    late_->add_late_doubts();
    late_->finish(context_.loop->now() + ReplayReports::kFileTime, [this](bool written) { end(written); });
  }

  void end(bool written) {
    if (!written) status_ = worse_exit_status(status_, exit_status::kRuntime);
    std::exchange(done_, {})(status_);
  }

  void on_complete(int exit_status) override {
    status_ = worse_exit_status(status_, exit_status);
    context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {  // the port has called
      if (!alive.expired()) finish_next();
    });
  }

  PortContext context_;
  PortSpec device_;
  std::string driver_;
  std::vector<TapePaths> tapes_;
  std::shared_ptr<ReplayReports::Group> reports_ = std::make_shared<ReplayReports::Group>();
  std::unique_ptr<Port> port_;  // of a tape that nobody came for
  std::unique_ptr<ReplayReports> late_;
  unsigned next_ = 1;
  int status_ = exit_status::kPass;
  std::function<void(int)> done_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

}  // namespace

std::vector<TapePaths> tapes_of_group(const TapePaths& first) {
  std::vector<TapePaths> tapes;
  for (const unsigned connection : recorded_connections(first))
    tapes.push_back(connection_tape(first, connection));
  return tapes;
}

std::unique_ptr<DeviceGroup> make_device_group(const PortContext& context, const PortSpec& device,
                                               const std::string& driver) {
  if (device.get<ReplayOptions>() != nullptr) return std::make_unique<TapedDevices>(context, device, driver);
  return std::make_unique<LiveDevices>(context, device, driver);
}

Result<void> check_connections(const PortSpec& driver, const PortSpec& device, bool each) {
  const bool listens = driver.written().flag("listen") && !driver.type().keeps_datagrams;
  if (!listens) {
    return usage_error(
        fmt::format("option 'connections' is for a driver's port that listens for connections "
                    "(tcp-listen:, unix-listen:); {} does not",
                    driver.name()));
  }
  const bool is_group = device.get<ReplayOptions>() != nullptr;  // of tapes, with one report
  if (!each || is_group) return {};
  const RecordingOptions* const recording = device.get<RecordingOptions>();
  const PortSpec& live = recording != nullptr ? recording->inner : device;
  if (live.type().exclusive) {
    return usage_error(
        fmt::format("option 'connections': 'each' gives every connection a device's port of its own, "
                    "and {} can be open once; take one",
                    live.name()));
  }
  for (const auto& [kind, where] : live.type().claims(live)) {
    return usage_error(
        fmt::format("option 'connections': 'each' gives every connection a device's port of its own, "
                    "and only one can have the {} {}; take one, or another port",
                    kind, where));
  }
  return {};
}

}  // namespace porttape
