#pragma once

#include <memory>
#include <string>

#include <spdlog/logger.h>

#include "libport/base/result.hpp"

namespace porttape {

// The program's log: stderr, with colours on a terminal and priorities for the journal, or a file.
Result<std::shared_ptr<spdlog::logger>> make_log(const std::string& file, spdlog::level::level_enum level);

}  // namespace porttape
