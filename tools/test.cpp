#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <memory>
#include <optional>
#include <ostream>
#include <signal.h>
#include <span>
#include <stdlib.h>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/program_options/errors.hpp>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "libport/port/port_factory.hpp"
#include "libport/port/replay_port.hpp"
#include "libport/port/report_file.hpp"
#include "libport/session/channel.hpp"
#include "libport/session/session.hpp"
#include "tools/child_process.hpp"
#include "tools/option_description.hpp"
#include "tools/output.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

using std::chrono::seconds;

constexpr Nanos kAfterHangUp = seconds(10);  // a command that goes on after a mismatch is ended then
constexpr Nanos kAfterTerm = seconds(5);     // … and killed then

constexpr std::string_view kHelp =
    "Usage: porttape test --tape NAME [options] -- COMMAND…\n\n"
    "Runs COMMAND against a tape in the device's place and prints the verdict. {port} in COMMAND is the path "
    "to open.\n\n"
    "Example: porttape test --tape laser -- ./laser_driver --device {port}\n";

struct Request {
  ChannelPorts ports;
  std::string report_file;
  std::optional<Nanos> timeout;
  std::vector<std::string> command;
};

// A folder of our own for the driver's port.
class PrivateFolder {
 public:
  Result<std::string> make() {
    std::string path = (std::filesystem::temp_directory_path() / "porttape-XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr)
      return make_error(Errc::io, fmt::format("folder '{}': {}", path, errno_text(errno)));
    path_ = path;
    return path;
  }
  PrivateFolder() = default;
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  ~PrivateFolder() {
    if (!path_.empty()) (void)::rmdir(path_.c_str());
  }

 private:
  std::string path_;
};

std::vector<OptionSpec> test_options() {
  std::vector<OptionSpec> specs = channel_options(ChannelMode::replay);
  std::erase_if(specs, [](const OptionSpec& spec) { return spec.name == "once"; });
  for (OptionSpec& spec : specs) {
    if (spec.name == "on-mismatch") spec.default_value = "fail";
    if (spec.name == "driver") spec.help = "PORT for the command instead of a pty in a private folder";
  }
  specs.push_back(
      {"timeout", OptionSpec::Kind::number, "", "seconds after which the command is ended", 0.001, 1e9});
  specs.push_back({"help", OptionSpec::Kind::flag, "", "this text"});
  return specs;
}

std::vector<std::string> with_port(std::vector<std::string> command, const std::string& port) {
  constexpr std::string_view placeholder = "{port}";
  for (std::string& argument : command) {
    for (std::size_t at = 0; (at = argument.find(placeholder, at)) != std::string::npos; at += port.size()) {
      argument.replace(at, placeholder.size(), port);
    }
  }
  return command;
}

// One run of a command against a tape.
class TestRun {
 public:
  explicit TestRun(Request request)
      : request_(std::move(request)),
        log_(std::make_shared<spdlog::logger>("porttape", std::make_shared<spdlog::sinks::stderr_sink_mt>())),
        kill_timer_(loop_, [this] { end_command(); }),
        signals_(loop_.io(), SIGINT, SIGTERM, SIGHUP) {
    log_->set_level(spdlog::level::err);
    log_->set_pattern("porttape: %v");
  }

  Result<RunReport> run() {
    if (Result<void> started = start_session(); !started) return started.error();
    if (Result<void> started = start_command(); !started) return started.error();
    while (command_->running()) loop_.run_one();
    while (loop_.poll_one()) {  // what the command did last
    }
    kill_timer_.cancel();
    if (session_) session_->stop();
    while (session_) loop_.run_one();
    return verdict();
  }

  // What the user should know beyond the verdict; empty when nothing.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  [[nodiscard]] bool interrupted() const { return interrupted_; }

 private:
  Result<void> start_session() {
    const PortContext context{&loop_, log_};
    const Result<ReplayConfig> config = replay_config(request_.ports.device);
    if (!config) return config.error();
    ReplayPort::Options options{
        literal_tape(request_.ports.device.text("file")), *config, false, {}, {}, true};
    options.on_report = [this](const RunReport& report) { take(report); };
    auto device = std::make_unique<ReplayPort>(context, std::move(options));
    Result<std::unique_ptr<Port>> driver = make_port(context, request_.ports.driver, device->name());
    if (!driver) return driver.error();
    session_ = std::make_unique<Session>(context, std::move(*driver), std::move(device), [this](int status) {
      session_status_ = status;
      session_.reset();
    });
    return session_->start();
  }

  Result<void> start_command() {
    const std::string name = session_->driver().name();
    const std::string port = name.substr(name.find(':') + 1);
    Result<std::unique_ptr<ChildProcess>> command =
        ChildProcess::start(loop_, with_port(request_.command, port), [] {});
    if (!command) return command.error();
    command_ = std::move(*command);
    if (request_.timeout) kill_timer_.set_after(*request_.timeout);
    wait_for_signal();
    return {};
  }

  void wait_for_signal() {
    signals_.async_wait([this](const boost::system::error_code& error, int number) {
      if (error) return;
      // The command gets the signal, then a while to end; a second signal ends it at once.
      command_->kill(interrupted_ ? SIGKILL : number);
      interrupted_ = true;
      terminated_ = true;
      kill_timer_.set_after(kAfterTerm);
      wait_for_signal();
    });
  }

  // Of several runs in one command the first that failed counts; one in which nothing passed (`stty` before
  // the driver proper) only when it is the last.
  void take(const RunReport& report) {
    if (session_ && session_->counters().opens == 0 && trouble_.empty())
      trouble_ = "the command never opened the port";
    const bool empty = report_ && report_->from_driver_bytes == 0 && report_->to_driver_bytes == 0;
    if (!report_ || empty || exit_status_of(*report_) == exit_status::kPass) report_ = report;
    const bool hung_up = report.mismatch && request_.ports.device.text("on-mismatch") == "fail";
    if (hung_up && command_ && command_->running() && !kill_timer_.due()) kill_timer_.set_after(kAfterHangUp);
  }

  void end_command() {
    if (!terminated_ && (!report_ || !report_->mismatch))
      trouble_ = "the command ran longer than --timeout and was ended";
    command_->kill(terminated_ ? SIGKILL : SIGTERM);
    terminated_ = true;
    kill_timer_.set_after(kAfterTerm);
  }

  Result<RunReport> verdict() {
    if (!report_)
      return make_error(session_status_ == exit_status::kDevice ? Errc::device_missing : Errc::io,
                        "there was no run; what went wrong is told above");
    report_->tape = request_.ports.device.text("file");
    report_->command_exit = command_->exit_code();
    return *report_;
  }

  Request request_;
  Loop loop_;
  std::shared_ptr<spdlog::logger> log_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<ChildProcess> command_;
  std::optional<RunReport> report_;
  Timer kill_timer_;
  boost::asio::signal_set signals_;
  std::string trouble_;
  int session_status_ = 0;
  bool terminated_ = false;
  bool interrupted_ = false;
};

Result<Request> read_request(const po::variables_map& values, const std::vector<OptionSpec>& specs,
                             PrivateFolder& folder, std::vector<std::string> command) {
  ChannelSpec channel{ChannelMode::replay, given_values(values, specs)};
  Request request;
  if (const auto timeout = channel.values.extract("timeout")) {
    const auto spec = std::ranges::find(specs, "timeout", &OptionSpec::name);
    const Result<std::string> checked = check_value(*spec, timeout.mapped());
    if (!checked) return checked.error();
    request.timeout = std::chrono::duration_cast<Nanos>(std::chrono::duration<double>(std::stod(*checked)));
  }
  channel.values.try_emplace("on-mismatch", "fail");
  if (!channel.values.contains("driver")) {
    const Result<std::string> path = folder.make();
    if (!path) return path.error();
    channel.values["driver"] = "pty:" + *path + "/port";
  }
  Result<ChannelPorts> ports = channel_ports(channel);
  if (!ports) return ports.error();
  request.ports = std::move(*ports);
  // The report is written here, once the command's exit status is known.
  request.report_file = request.ports.device.text("report");
  request.ports.device.values.erase("report");
  if (!request.report_file.empty()) {
    if (Result<void> place = check_report_place(request.report_file); !place) return place.error();
  }
  if (command.empty())
    return make_error(Errc::usage, "the command is missing: porttape test --tape NAME -- COMMAND…");
  request.command = std::move(command);
  return request;
}

int exit_status_with(const RunReport& report, const TestRun& test) {
  const int status = exit_status_of(report);
  if (status != exit_status::kPass) return status;
  const bool failed = report.command_exit.value_or(0) != 0 || !test.trouble().empty() || test.interrupted();
  return failed ? exit_status::kRuntime : exit_status::kPass;
}

int fail(const Error& error, std::ostream& err) {
  fmt::print(err, "porttape test: {}\n", error.message);
  return exit_status_of(error.code);
}

int run_request(const Request& request, std::ostream& out, std::ostream& err) {
  ::signal(SIGPIPE, SIG_IGN);
  TestRun test(request);
  const Result<RunReport> report = test.run();
  if (!report) return fail(report.error(), err);
  out << to_text(*report, wants_color(out)) << std::flush;
  if (!test.trouble().empty()) fmt::print(err, "porttape test: {}\n", test.trouble());
  if (report->command_exit.value_or(0) != 0)
    fmt::print(err, "porttape test: the command ended with status {}\n", *report->command_exit);
  if (!request.report_file.empty()) {
    if (Result<void> written = write_report(request.report_file, to_json(*report)); !written)
      return fail(written.error(), err);
  }
  return exit_status_with(*report, test);
}

}  // namespace

int run_test(Arguments args, std::ostream& out, std::ostream& err) {
  const auto separator = std::ranges::find(args, "--");
  const Arguments options(args.begin(), separator);
  std::vector<std::string> command;
  if (separator != args.end()) command.assign(separator + 1, args.end());
  const std::vector<OptionSpec> specs = test_options();
  try {
    const po::options_description description = describe(specs, "Options");
    const po::variables_map values = read_options(options, description);
    if (values.contains("help")) {
      out << kHelp << '\n' << as_text(description);
      return exit_status::kPass;
    }
    PrivateFolder folder;
    const Result<Request> request = read_request(values, specs, folder, std::move(command));
    if (!request) return fail(request.error(), err);
    return run_request(*request, out, err);
  } catch (const po::error& error) {
    return fail(make_error(Errc::usage, fmt::format("{}; see porttape test --help", error.what())), err);
  }
}

}  // namespace porttape
