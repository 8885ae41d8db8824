#include "daemon/log.hpp"

#include <cstdlib>
#include <fmt/format.h>
#include <string_view>
#include <utility>

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include "libport/port/printable_message.hpp"

namespace porttape {
namespace {

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

std::unique_ptr<spdlog::formatter> make_formatter(bool journal) {
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableMessage>('v');
  if (journal) {
    formatter->add_flag<JournalPriority>('*').set_pattern("%*%n: %v");
  } else {
    formatter->set_pattern(kPattern);
  }
  return formatter;
}

}  // namespace

Result<std::shared_ptr<spdlog::logger>> make_log(const std::string& file, spdlog::level::level_enum level) {
  spdlog::sink_ptr sink;
  bool journal = false;
  if (file.empty()) {
    journal = std::getenv("JOURNAL_STREAM") != nullptr;
    sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  } else {
    try {
      sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(file);
    } catch (const spdlog::spdlog_ex& error) {
      return make_error(Errc::usage, fmt::format("option 'log-file': {}", error.what()));
    }
  }
  auto log = std::make_shared<spdlog::logger>("porttaped", std::move(sink));
  log->set_formatter(make_formatter(journal));
  log->set_level(level);
  log->flush_on(spdlog::level::info);
  return log;
}

}  // namespace porttape
