#pragma once

#include <fmt/format.h>
#include <span>
#include <string>

#include "libport/blocking/blocking_port.hpp"

namespace porttape {

inline std::span<Byte> room(std::string& text) { return {reinterpret_cast<Byte*>(text.data()), text.size()}; }

// "12 text", "timed out", "closed" or "error: …": how a call ended.
inline std::string told(const Result<Transfer>& result, const std::string& text = {}) {
  if (!result) return "error: " + result.error().message;
  if (result->end == Transfer::End::timed_out) return "timed out";
  if (result->end == Transfer::End::closed) return "closed";
  return fmt::format("{} {}", result->bytes, text.substr(0, result->bytes));
}

inline std::string read_some(BlockingPort& port, std::size_t most = 100) {
  std::string text(most, '?');
  const Result<Transfer> result = port.read(room(text));
  return told(result, text);
}

}  // namespace porttape
