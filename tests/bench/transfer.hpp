#pragma once

#include <cstdint>

namespace porttape::bench {

// Sends `size` bytes of the pattern from `offset` on, in blocking writes of `write_size`.
void flood(int fd, std::uint64_t offset, std::uint64_t size, std::size_t write_size);

// Reads and checks `size` bytes of the pattern from `offset` on.
void sink(int fd, std::uint64_t offset, std::uint64_t size);

}  // namespace porttape::bench
