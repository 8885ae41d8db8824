#pragma once

#include <cstdint>

#include <boost/crc.hpp>

#include "libport/base/bytes.hpp"

namespace porttape {

// CRC-32/ISO-HDLC (zlib's) of bytes that come in pieces.
class Crc32 {
 public:
  void add(ByteView bytes) { crc_.process_bytes(bytes.data(), bytes.size()); }
  [[nodiscard]] std::uint32_t value() const { return crc_.checksum(); }

 private:
  boost::crc_32_type crc_;
};

}  // namespace porttape
