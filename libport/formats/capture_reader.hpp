#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/formats/evidence.hpp"
#include "libport/formats/octets.hpp"

namespace porttape {

struct CaptureInterface {
  std::uint32_t link_type = 0;
  std::uint32_t snap_length = 0;  // 0: none
  std::string name;
  std::string description;
  std::uint64_t units = 1'000'000;  // of its times, in a second
  std::int64_t offset_s = 0;
};

struct CapturePacket {
  std::uint64_t offset = 0;  // of its block in the file
  std::size_t interface = 0;
  std::optional<std::int64_t> us;  // since 1970
  ByteView data;                   // valid until the next one, as the comments are
  std::uint32_t length = 0;        // on the line; more than `data` where not all was kept
  std::vector<std::string_view> comments;
};

// Reads a capture of packets, pcap or pcapng, of either byte order, from front to back; of pcapng the section
// header, interface, packet (enhanced, simple, obsolete) blocks, everything else is skipped. Memory: the
// largest block there is. Not thread-safe.
class CaptureReader {
 public:
  using Tell = std::function<void(std::string problem)>;

  // Errc::not_a_tape: it begins as neither. Both are to live as long. A packet that is wrong in itself is
  // told, and left out.
  static Result<CaptureReader> open(Evidence& from, Tell tell);

  // Nothing: the end. Errc::damaged_tape: where what follows cannot be found.
  Result<std::optional<CapturePacket>> next();

  // Of the section that the last packet is in.
  [[nodiscard]] const std::vector<CaptureInterface>& interfaces() const { return interfaces_; }
  [[nodiscard]] const std::vector<std::string>& section_comments() const { return section_comments_; }
  [[nodiscard]] std::size_t section() const { return section_; }  // from 1
  [[nodiscard]] Endian endian() const { return endian_; }
  // It ends within a block or packet.
  [[nodiscard]] bool torn() const { return torn_; }

 private:
  explicit CaptureReader(Evidence& from, Tell tell) : from_(from), tell_(std::move(tell)) {}

  struct Options;
  Result<void> begin_pcap(Endian endian, std::uint64_t units);
  Result<std::optional<CapturePacket>> next_of_pcap();
  Result<std::optional<CapturePacket>> next_block();
  Result<void> begin_section(ByteView body);
  Result<void> add_interface(ByteView body);
  std::optional<CapturePacket> packet(std::uint32_t type, ByteView body);
  template <class Take>
  void each_option(ByteView options, const Take& take) const;

  // Whether all was there; the bytes are in buffer_.
  Result<bool> read_all(std::uint64_t size);
  void ends_early();
  [[nodiscard]] Error damage(std::string_view what) const { return from_.get().error_at(block_at_, what); }
  template <std::unsigned_integral Number>
  [[nodiscard]] Number number(ByteView bytes, std::size_t at) const {
    return number_in<Number>(bytes, at, endian_);
  }
  [[nodiscard]] std::int64_t us_of(std::uint64_t time, const CaptureInterface& interface) const;

  std::reference_wrapper<Evidence> from_;
  Tell tell_;
  bool is_pcap_ = false;
  Endian endian_ = Endian::little;
  std::vector<CaptureInterface> interfaces_;
  std::vector<std::string> section_comments_;
  std::size_t section_ = 0;
  Bytes buffer_;
  std::uint64_t block_at_ = 0;
  bool torn_ = false;
};

// The link type of the first interface; nothing: these are no capture's first bytes, or do not tell it.
std::optional<std::uint32_t> first_link_type(std::string_view head);
bool is_pcapng(std::string_view head);

}  // namespace porttape
