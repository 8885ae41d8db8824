#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"

// Blocks of a tape, written and read here on their own so that the library is not measured against itself:
// u32 seconds, u32 microseconds, u32 length, big-endian, then the bytes.
namespace porttape::bench {

class BlockFile {
 public:
  enum class Mode { read, write };
  BlockFile(const std::string& path, Mode mode);
  ~BlockFile();
  BlockFile(const BlockFile&) = delete;
  BlockFile& operator=(const BlockFile&) = delete;

  void put(std::int64_t time_us, const Byte* data, std::size_t size);
  void finish();  // flush and close, checked

  struct Block {
    std::int64_t time_us = 0;
    Bytes data;
  };
  bool get(Block& block);  // false at the end; a torn block is an error

 private:
  std::string path_;
  std::FILE* file_;
  Bytes buffer_;
};

struct Arrival {
  std::int64_t time_us;
  std::uint64_t end;  // of its bytes in the stream
};
std::vector<Arrival> arrivals_of(const std::string& tape);

// Throws unless the file's payload is `skip` bytes of anything, then the pattern from its start, `size` bytes
// in all.
void check_pattern_file(const std::string& path, std::uint64_t skip, std::uint64_t size);

}  // namespace porttape::bench
