#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/formats/uart_options.hpp"

namespace porttape {

// What a session of sigrok says of its samples.
struct SrMetadata {
  std::string capture;  // its samples are files of this name, and this and -1, -2, …
  std::uint64_t rate = 0;
  unsigned unit_size = 1;
  std::vector<std::string> channels;  // by bit; empty: not used
  SeenSettings line;                  // ours alone
  std::uint64_t lead = 0;             // samples before the tape's zero

  // Errc::damaged_tape.
  static Result<SrMetadata> parse(std::string_view text);
  // The number of a channel: by name, whatever the case, or as told.
  [[nodiscard]] std::optional<unsigned> channel(std::string_view name) const;
};

}  // namespace porttape
