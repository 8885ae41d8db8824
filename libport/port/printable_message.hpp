#pragma once

#include <ctime>
#include <memory>

#include <spdlog/pattern_formatter.h>

#include "libport/base/printable.hpp"

namespace porttape {

// A log's message (%v) without anything that a terminal would obey: names of files and ports are anybody's.
class PrintableMessage final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& out) override {
    const std::string text = printable_lines({message.payload.data(), message.payload.size()});
    out.append(text.data(), text.data() + text.size());
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<PrintableMessage>();
  }
};

}  // namespace porttape
