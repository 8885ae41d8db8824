#pragma once

#include <memory>
#include <mutex>
#include <sstream>
#include <string>

#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>

namespace porttape {

// A log that a test can look into.
class LogBook {
 public:
  [[nodiscard]] std::shared_ptr<spdlog::logger> log() const { return log_; }
  [[nodiscard]] std::string text() const { return out_.str(); }

 private:
  std::ostringstream out_;
  std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_st>(out_));
};

}  // namespace porttape
