#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "libport/tape/new_file.hpp"

namespace porttape {

enum class CaptureWay : std::uint8_t { none, inbound, outbound };

struct PacketToWrite {
  std::uint64_t us = 0;  // since 1970
  std::string_view head;
  ByteView data;  // behind it
  CaptureWay way = CaptureWay::none;
  std::vector<std::string> comments;  // UTF-8, at most kLongestComment each
};

// Writes a capture of one interface. Not thread-safe.
class CaptureWriter {
 public:
  static constexpr std::size_t kLongestComment = 65'000;

  explicit CaptureWriter(NewFile& to) : to_(to) {}
  CaptureWriter(const CaptureWriter&) = delete;
  CaptureWriter& operator=(const CaptureWriter&) = delete;
  virtual ~CaptureWriter() = default;

  // Errc::io.
  virtual Result<void> add(const PacketToWrite& packet) = 0;

 protected:
  NewFile& to_;
};

// pcapng, little-endian, times in microseconds.
class PcapngWriter final : public CaptureWriter {
 public:
  using CaptureWriter::CaptureWriter;

  struct Section {
    std::string hardware;
    std::string os;
    std::string program;
    std::vector<std::string> comments;
    std::uint16_t link_type = 0;
    std::string interface;  // its name
  };
  Result<void> begin(const Section& section);
  Result<void> add(const PacketToWrite& packet) override;

 private:
  Result<void> block(std::uint32_t type, std::string_view body);
};

// pcap, little-endian, times in microseconds; comments and ways are left out.
class PcapWriter final : public CaptureWriter {
 public:
  using CaptureWriter::CaptureWriter;

  Result<void> begin(std::uint32_t link_type);
  Result<void> add(const PacketToWrite& packet) override;
};

}  // namespace porttape
