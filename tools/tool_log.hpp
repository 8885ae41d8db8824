#pragma once

#include <memory>
#include <string_view>

#include <spdlog/logger.h>

namespace porttape {

// The log of a verb: to stderr, each line behind `name`.
std::shared_ptr<spdlog::logger> make_tool_log(std::string_view name, spdlog::level::level_enum level);

// Whether the program was started so that the signal does nothing (nohup).
bool is_ignored(int signal_number);

}  // namespace porttape
