#include "daemon/log.hpp"

#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <mutex>
#include <pwd.h>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include <spdlog/logger.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/sink.h>

#include "daemon/log_target.hpp"
#include "libport/port/printable_message.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

enum class Style { plain, coloured, priorities };

// "<6>": the priority as sd-daemon(3) wants it in front of a line.
class JournalPriority final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& out) override {
    constexpr std::string_view priorities = "7764321";  // trace, debug, info, warn, error, critical, off
    const auto level = static_cast<std::size_t>(message.level);
    fmt::format_to(std::back_inserter(out), "<{}>", priorities[level]);
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<JournalPriority>();
  }
};

constexpr const char* kPattern = "%Y-%m-%d %H:%M:%S.%e %^%l%$ %n: %v";

std::unique_ptr<spdlog::formatter> make_formatter(Style style) {
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableMessage>('v');
  if (style == Style::priorities) {
    formatter->add_flag<JournalPriority>('*').set_pattern("%*%n: %v");
  } else {
    formatter->set_pattern(kPattern);
  }
  return formatter;
}

std::string_view colour_of(spdlog::level::level_enum level) {
  switch (level) {
    case spdlog::level::info:
      return "\033[32m";
    case spdlog::level::warn:
      return "\033[33m";
    case spdlog::level::err:
    case spdlog::level::critical:
      return "\033[31m";
    default:
      return "\033[36m";
  }
}

// Formats lines for a LogQueue.
class QueueSink final : public spdlog::sinks::sink {
 public:
  QueueSink(std::unique_ptr<LogTarget> target, Style style)
      : style_(style),
        formatter_(make_formatter(style)),
        queue_(std::move(target), [style](std::size_t lines) {
          return fmt::format("{}{} lines of the log are lost: they came faster than they could be written\n",
                             style == Style::priorities ? "<4>" : "porttaped: ", lines);
        }) {}

  void log(const spdlog::details::log_msg& message) override {
    const std::lock_guard lock(mutex_);
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    const std::string_view text(line.data(), line.size());
    if (style_ != Style::coloured || message.color_range_end <= message.color_range_start)
      return queue_.add(text);
    queue_.add(fmt::format(
        "{}{}{}\033[m{}", text.substr(0, message.color_range_start), colour_of(message.level),
        text.substr(message.color_range_start, message.color_range_end - message.color_range_start),
        text.substr(message.color_range_end)));
  }
  void flush() override {}
  void set_pattern(const std::string& pattern) override {
    set_formatter(std::make_unique<spdlog::pattern_formatter>(pattern));
  }
  void set_formatter(std::unique_ptr<spdlog::formatter> formatter) override {
    const std::lock_guard lock(mutex_);
    formatter_ = std::move(formatter);
  }
  void reopen() { queue_.reopen(); }

 private:
  const Style style_;
  std::mutex mutex_;  // guards the formatter
  std::unique_ptr<spdlog::formatter> formatter_;
  LogQueue queue_;
};

// Whether stderr is the one that systemd connected to the journal (systemd.exec(5), JOURNAL_STREAM).
bool stderr_is_journal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat status {};
  if (stream == nullptr || ::fstat(STDERR_FILENO, &status) != 0) return false;
  return fmt::format("{}:{}", status.st_dev, status.st_ino) == stream;
}

bool stderr_has_colours() {
  const char* terminal = std::getenv("TERM");
  return ::isatty(STDERR_FILENO) == 1 && std::getenv("NO_COLOR") == nullptr && terminal != nullptr &&
         std::string_view(terminal) != "dumb";
}

// $XDG_STATE_HOME/porttape/PID.log; its folder is made.
Result<std::string> state_file() {
  const char* state = std::getenv("XDG_STATE_HOME");
  const char* home = std::getenv("HOME");
  fs::path folder;
  if (state != nullptr && *state == '/') {
    folder = state;
  } else if (home != nullptr && *home == '/') {
    folder = fs::path(home) / ".local/state";
  } else if (const passwd* user = ::getpwuid(::getuid()); user != nullptr) {
    folder = fs::path(user->pw_dir) / ".local/state";
  }
  folder /= "porttape";
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    return make_error(Errc::usage, fmt::format("the log has no place: {}: {}; name one with --log-file",
                                               folder.string(), error.message()));
  }
  return (folder / fmt::format("{}.log", ::getpid())).string();
}

struct Chosen {
  std::unique_ptr<LogTarget> target;
  Style style = Style::plain;
  std::string place;
};

Result<Chosen> file_target(const std::string& file) {
  Result<std::unique_ptr<LogTarget>> target = FileTarget::open(file);
  if (!target) return target.error();
  return Chosen{std::move(*target), Style::plain, file};
}

Result<Chosen> choose(const LogPlace& place) {
  using Protocol = SocketTarget::Protocol;
  if (!place.file.empty()) return file_target(place.file);
  if (!place.background) {
    const Style style = stderr_is_journal()    ? Style::priorities
                        : stderr_has_colours() ? Style::coloured
                                               : Style::plain;
    return Chosen{FileTarget::stderr_target(), style, {}};
  }
  if (auto journal = SocketTarget::connect(place.journal, Protocol::journal))
    return Chosen{std::move(journal), Style::priorities, "the journal"};
  if (auto syslog = SocketTarget::connect(place.syslog, Protocol::syslog))
    return Chosen{std::move(syslog), Style::priorities, "syslog"};
  const Result<std::string> file = state_file();
  if (!file) return file.error();
  return file_target(*file);
}

}  // namespace

Result<Log> make_log(const LogPlace& place, spdlog::level::level_enum level) {
  Result<Chosen> chosen = choose(place);
  if (!chosen) return chosen.error();
  const auto sink = std::make_shared<QueueSink>(std::move(chosen->target), chosen->style);
  Log log{std::make_shared<spdlog::logger>("porttaped", sink), [sink] { sink->reopen(); }, chosen->place};
  sink->set_level(level);  // a channel's logger may ask for more, for sinks of its own
  log.logger->set_level(level);
  return log;
}

}  // namespace porttape
