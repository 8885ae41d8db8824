#include "tools/tool_log.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <utility>

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "libport/port/printable_message.hpp"

namespace porttape {

std::shared_ptr<spdlog::logger> make_tool_log(std::string_view name, spdlog::level::level_enum level) {
  auto log = std::make_shared<spdlog::logger>("porttape", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  log->set_level(level);
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableMessage>('v').set_pattern(fmt::format("{}: %v", name));
  log->set_formatter(std::move(formatter));
  return log;
}

bool is_ignored(int signal_number) {
  struct sigaction action {};
  return ::sigaction(signal_number, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace porttape
