#include "libport/testing/tape_device.hpp"

#include <cerrno>
#include <filesystem>
#include <functional>
#include <future>
#include <optional>
#include <ostream>
#include <sstream>
#include <stdexcept>
#include <stdlib.h>
#include <thread>
#include <unistd.h>
#include <utility>

#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/loop/loop.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/run_list.hpp"
#include "libport/session/channel.hpp"
#include "libport/session/make_session.hpp"
#include "libport/taped/replay_options.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

// A folder for the port, where none is named.
class Folder {
 public:
  Folder() {
    std::string path = (std::filesystem::temp_directory_path() / "porttape-XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr)
      throw std::runtime_error("folder " + in_quotes(path) + ": " + errno_text(errno));
    path_ = path;
  }
  ~Folder() { (void)::rmdir(path_.c_str()); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

ChannelPorts ports_of(const std::string& tape, std::map<std::string, std::string> values) {
  values["tape"] = tape;
  set_replay_defaults(ReplayUse::test, values);
  Result<ChannelPorts> ports = channel_ports({ChannelMode::replay, std::move(values)});
  if (!ports) throw std::runtime_error(ports.error().message);
  return std::move(*ports);
}

TapeVerdict failed(std::string why) {
  return {.passed = false, .exit_status = exit_status::kRuntime, .text = std::move(why) + '\n', .json = {}};
}

}  // namespace

std::ostream& operator<<(std::ostream& out, const TapeVerdict& verdict) { return out << verdict.text; }

// Its thread makes the loop and everything on it, and tells the place or what is wrong.
class TapeDevice::Player {
 public:
  Player(const std::string& tape, Options values) {
    if (!values.contains("driver")) values["driver"] = "pty:" + folder_.emplace().path() + "/port";
    ChannelPorts ports = ports_of(tape, std::move(values));
    ReplayOptions replay = *ports.device.get<ReplayOptions>();
    replay.ends_with_run = true;
    replay.on_report = [this](const RunReport& report) { runs_.add(report); };
    ports.device.set(std::move(replay));
    std::promise<PortPlace> ready;
    std::future<PortPlace> place = ready.get_future();
    thread_ = std::thread(
        [this, ports = std::move(ports), ready = std::move(ready)]() mutable { play(ports, ready); });
    try {
      place_ = place.get();
    } catch (...) {
      thread_.join();
      throw;
    }
    port_ = place_.text();
  }
  ~Player() { (void)verdict(); }
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;

  const TapeVerdict& verdict() {
    if (verdict_) return *verdict_;
    stop_([this] { channel_->stop(); });
    thread_.join();
    const std::optional<RunReport>& worst = runs_.worst();
    if (!worst) return verdict_.emplace(failed("there was no run: " + log_.str()));
    RunReport report = *worst;
    // An end that no report has: a tape that was given up.
    report.process_exit = worse_exit_status(exit_status_of(report), status_);
    const bool passed = *report.process_exit == exit_status::kPass;
    return verdict_.emplace(TapeVerdict{.passed = passed,
                                        .exit_status = *report.process_exit,
                                        .text = to_text(report) + log_.str(),
                                        .json = to_json(report, runs_.json())});
  }

  [[nodiscard]] const std::string& port() const { return port_; }
  [[nodiscard]] const PortPlace& place() const { return place_; }

 private:
  struct EndsBefore {
    std::unique_ptr<Channel>& channel;
    ~EndsBefore() { channel.reset(); }
  };

  void play(const ChannelPorts& ports, std::promise<PortPlace>& ready) {
    try {
      Loop loop;
      const EndsBefore channel_ends{channel_};  // the loop does, also where something is thrown
      begin(loop, ports);
      ready.set_value(channel_->driver().place());
      while (channel_ && !ended_) loop.run_one();
    } catch (...) {
      give_up(ready, std::current_exception());
    }
  }

  void begin(Loop& loop, const ChannelPorts& ports) {
    auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(log_);
    auto log = std::make_shared<spdlog::logger>("porttape", std::move(sink));
    log->set_level(spdlog::level::err);
    log->set_pattern("%v");
    Result<std::unique_ptr<Channel>> made =
        make_channel({.loop = &loop, .log = std::move(log), .announces = false}, ports, [this](int status) {
          status_ = status;
          ended_ = true;
        });
    if (!made) throw std::runtime_error(made.error().message);
    channel_ = std::move(*made);
    if (Result<void> begun = channel_->start(); !begun) throw std::runtime_error(begun.error().message);
    stop_ = loop.poster();
  }

  // Before it was ready it is the constructor's error; later the verdict has it.
  void give_up(std::promise<PortPlace>& ready, const std::exception_ptr& error) {
    try {
      ready.set_exception(error);
    } catch (const std::future_error&) {
      status_ = exit_status::kRuntime;
    }
  }

  std::optional<Folder> folder_;
  std::ostringstream log_;
  RunList runs_;
  std::unique_ptr<Channel> channel_;
  std::function<void(std::function<void()>)> stop_;
  PortPlace place_;
  std::string port_;
  int status_ = 0;
  bool ended_ = false;
  std::optional<TapeVerdict> verdict_;
  std::thread thread_;
};

TapeDevice::TapeDevice(const std::string& tape, const Options& options)
    : player_(std::make_unique<Player>(tape, options)) {}
TapeDevice::~TapeDevice() = default;

const std::string& TapeDevice::port() const { return player_->port(); }
const std::string& TapeDevice::host() const { return player_->place().host; }
unsigned TapeDevice::tcp_port() const { return static_cast<unsigned>(player_->place().port); }
const TapeVerdict& TapeDevice::verdict() { return player_->verdict(); }

}  // namespace porttape
