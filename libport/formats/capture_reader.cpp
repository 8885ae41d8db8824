#include "libport/formats/capture_reader.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <limits>

namespace porttape {
namespace {

constexpr std::uint32_t kSection = 0x0a0d0d0a;
constexpr std::uint32_t kInterface = 1;
constexpr std::uint32_t kOldPacket = 2;
constexpr std::uint32_t kSimplePacket = 3;
constexpr std::uint32_t kPacket = 6;
constexpr std::uint32_t kOrderMagic = 0x1a2b3c4d;
constexpr std::uint32_t kPcapMicros = 0xa1b2c3d4;
constexpr std::uint32_t kPcapNanos = 0xa1b23c4d;
constexpr std::uint64_t kMicros = 1'000'000;
constexpr std::uint64_t kNanos = 1'000'000'000;

constexpr std::size_t kBlockFrame = 12;  // type and length, and length again
constexpr std::uint32_t kLargestBlock = 64U << 20U;
constexpr std::size_t kMostInterfaces = 65'536;

constexpr std::uint16_t kComment = 1;
constexpr std::uint16_t kInterfaceName = 2;
constexpr std::uint16_t kInterfaceDescription = 3;
constexpr std::uint16_t kTimeResolution = 9;
constexpr std::uint16_t kTimeOffset = 14;

bool has_packet(std::uint32_t type) { return type == kPacket || type == kSimplePacket || type == kOldPacket; }

std::uint64_t padded(std::uint64_t size) { return (size + 3) / 4 * 4; }

// Units in a second as `if_tsresol` has them; 0: more than can be counted.
std::uint64_t units_of(Byte resolution) {
  const unsigned exponent = resolution & 0x7fU;
  if ((resolution & 0x80U) != 0) return exponent > 62 ? 0 : std::uint64_t{1} << exponent;
  if (exponent > 18) return 0;
  std::uint64_t units = 1;
  for (unsigned i = 0; i < exponent; ++i) units *= 10;
  return units;
}

}  // namespace

Result<CaptureReader> CaptureReader::open(Evidence& from, Tell tell) {
  CaptureReader reader(from, std::move(tell));
  const auto head = from.peek(4);
  if (!head) return head.error();
  if (head->size() == 4) {
    for (const Endian endian : {Endian::little, Endian::big}) {
      const auto magic = number_in<std::uint32_t>(*head, 0, endian);
      if (magic == kSection) return reader;
      if (magic != kPcapMicros && magic != kPcapNanos) continue;
      const Result<void> begun = reader.begin_pcap(endian, magic == kPcapNanos ? kNanos : kMicros);
      if (!begun) return begun.error();
      return reader;
    }
  }
  return make_error(Errc::not_a_tape, from.name() + " is no capture: it begins as neither pcapng nor pcap");
}

Result<void> CaptureReader::begin_pcap(Endian endian, std::uint64_t units) {
  constexpr std::size_t kHeader = 24;
  is_pcap_ = true;
  endian_ = endian;
  section_ = 1;
  const auto all = read_all(kHeader);
  if (!all) return all.error();
  if (!*all) {
    ends_early();
    return {};
  }
  CaptureInterface interface;
  interface.link_type = number<std::uint32_t>(buffer_, 20) & 0xffffU;
  interface.units = units;
  interfaces_.push_back(std::move(interface));
  return {};
}

Result<std::optional<CapturePacket>> CaptureReader::next() {
  if (torn_) return std::optional<CapturePacket>{};
  return is_pcap_ ? next_of_pcap() : next_block();
}

Result<std::optional<CapturePacket>> CaptureReader::next_of_pcap() {
  constexpr std::size_t kHead = 16;
  block_at_ = from_.get().offset();
  const auto head = read_all(kHead);
  if (!head) return head.error();
  if (!*head) {
    if (!buffer_.empty()) ends_early();
    return std::optional<CapturePacket>{};
  }
  CapturePacket packet;
  packet.offset = block_at_;
  const CaptureInterface& interface = interfaces_.front();
  const std::uint64_t parts = number<std::uint32_t>(buffer_, 4);
  packet.us = us_of(number<std::uint32_t>(buffer_, 0) * interface.units + parts, interface);
  const auto kept = number<std::uint32_t>(buffer_, 8);
  packet.length = number<std::uint32_t>(buffer_, 12);
  if (kept > kLargestBlock)
    return damage(fmt::format("a packet of {} bytes; it begins or has ended elsewhere", kept));
  const auto all = read_all(kept);
  if (!all) return all.error();
  if (!*all) {
    ends_early();
    return std::optional<CapturePacket>{};
  }
  packet.data = buffer_;
  return std::optional(std::move(packet));
}

Result<std::optional<CapturePacket>> CaptureReader::next_block() {
  for (;;) {
    block_at_ = from_.get().offset();
    const auto head = from_.get().peek(kBlockFrame);
    if (!head) return head.error();
    if (head->empty()) return std::optional<CapturePacket>{};
    if (head->size() < kBlockFrame) {
      ends_early();
      return std::optional<CapturePacket>{};
    }
    auto type = number<std::uint32_t>(*head, 0);
    if (type == kSection) {
      const auto magic = number_in<std::uint32_t>(*head, 8, Endian::little);
      endian_ = magic == kOrderMagic ? Endian::little : Endian::big;
      if (number<std::uint32_t>(*head, 8) != kOrderMagic)
        return damage("a section header without the magic number of its byte order");
    }
    const auto length = number<std::uint32_t>(*head, 4);
    if (length < kBlockFrame || length % 4 != 0)
      return damage(
          fmt::format("a block of type 0x{:08x} that claims {} bytes, which none has", type, length));
    const bool wanted = has_packet(type) || type == kSection || type == kInterface;
    if (wanted && length > kLargestBlock)
      return damage(fmt::format("a block of {} bytes, more than 64 MiB", length));
    if (!wanted) {
      const auto skipped = from_.get().skip(length);
      if (!skipped) return skipped.error();
      if (*skipped < length) ends_early();
      if (*skipped < length) return std::optional<CapturePacket>{};
      continue;
    }
    const auto all = read_all(length);
    if (!all) return all.error();
    if (!*all) {
      ends_early();
      return std::optional<CapturePacket>{};
    }
    if (number<std::uint32_t>(buffer_, length - 4) != length)
      return damage("a block whose length at its end is another one than at its beginning");
    const ByteView body = ByteView(buffer_).subspan(8, length - kBlockFrame);
    if (has_packet(type)) {
      if (auto found = packet(type, body)) return found;
      continue;
    }
    if (Result<void> taken = type == kSection ? begin_section(body) : add_interface(body); !taken)
      return taken.error();
  }
}

Result<void> CaptureReader::begin_section(ByteView body) {
  constexpr std::size_t kFixed = 16;
  if (body.size() < kFixed) return damage("a section header that is too short");
  const auto major = number<std::uint16_t>(body, 4);
  if (major != 1) return damage(fmt::format("pcapng of version {}; only version 1 is read", major));
  ++section_;
  interfaces_.clear();
  section_comments_.clear();
  each_option(body.subspan(kFixed), [this](std::uint16_t code, ByteView value) {
    if (code == kComment) section_comments_.emplace_back(as_text(value));
  });
  return {};
}

Result<void> CaptureReader::add_interface(ByteView body) {
  constexpr std::size_t kFixed = 8;
  if (body.size() < kFixed) return damage("an interface block that is too short");
  if (interfaces_.size() == kMostInterfaces) return damage("more than 65536 interfaces");
  CaptureInterface interface;
  interface.link_type = number<std::uint16_t>(body, 0);
  interface.snap_length = number<std::uint32_t>(body, 4);
  each_option(body.subspan(kFixed), [&](std::uint16_t code, ByteView value) {
    if (code == kInterfaceName) interface.name = as_text(value);
    if (code == kInterfaceDescription) interface.description = as_text(value);
    if (code == kTimeResolution && !value.empty()) interface.units = units_of(value.front());
    if (code == kTimeOffset && value.size() == 8)
      interface.offset_s = static_cast<std::int64_t>(number<std::uint64_t>(value, 0));
  });
  if (interface.units == 0) return damage("an interface whose times are finer than can be counted");
  interfaces_.push_back(std::move(interface));
  return {};
}

std::optional<CapturePacket> CaptureReader::packet(std::uint32_t type, ByteView body) {
  const std::size_t fixed = type == kSimplePacket ? 4 : 20;
  const auto wrong = [&](std::string_view what) {
    tell_(damage(what).message);
    return std::optional<CapturePacket>{};
  };
  if (body.size() < fixed) return wrong("a packet that is too short; it is left out");
  CapturePacket packet;
  packet.offset = block_at_;
  if (type != kSimplePacket)
    packet.interface =
        type == kPacket ? number<std::uint32_t>(body, 0) : std::size_t{number<std::uint16_t>(body, 0)};
  if (packet.interface >= interfaces_.size())
    return wrong(
        fmt::format("a packet of interface {}, which was not told of; it is left out", packet.interface));
  const CaptureInterface& interface = interfaces_[packet.interface];
  packet.length = number<std::uint32_t>(body, fixed - 4);
  std::uint32_t kept = packet.length;
  if (type == kSimplePacket) {
    if (interface.snap_length != 0) kept = std::min(kept, interface.snap_length);
  } else {
    kept = number<std::uint32_t>(body, 12);
    const std::uint64_t high = number<std::uint32_t>(body, 4);
    packet.us = us_of(high << 32U | number<std::uint32_t>(body, 8), interface);
  }
  if (kept > body.size() - fixed)
    return wrong(fmt::format("a packet of {} bytes in a block that holds {}; it is left out", kept,
                             body.size() - fixed));
  packet.data = body.subspan(fixed, kept);
  const std::uint64_t options = fixed + padded(kept);
  if (type == kPacket && options < body.size())
    each_option(body.subspan(options), [&](std::uint16_t code, ByteView value) {
      if (code == kComment) packet.comments.push_back(as_text(value));
    });
  return packet;
}

template <class Take>
void CaptureReader::each_option(ByteView options, const Take& take) const {
  while (options.size() >= 4) {
    const auto code = number<std::uint16_t>(options, 0);
    const auto length = number<std::uint16_t>(options, 2);
    options = options.subspan(4);
    if (code == 0 || length > options.size()) return;
    take(code, options.first(length));
    options = options.subspan(std::min<std::size_t>(padded(length), options.size()));
  }
}

// Grows with what is there, whatever was promised.
Result<bool> CaptureReader::read_all(std::uint64_t size) {
  buffer_.clear();
  while (buffer_.size() < size) {
    const std::size_t had = buffer_.size();
    const std::size_t wanted = std::min<std::uint64_t>(size - had, Evidence::kPeeked);
    buffer_.resize(had + wanted);
    const auto got = from_.get().read(std::span(buffer_).subspan(had));
    if (!got) return got.error();
    buffer_.resize(had + *got);
    if (*got < wanted) return false;
  }
  return true;
}

void CaptureReader::ends_early() {
  torn_ = true;
  tell_(from_.get()
            .error_at(from_.get().offset(), fmt::format("it ends within what begins at byte {}", block_at_))
            .message);
}

std::int64_t CaptureReader::us_of(std::uint64_t time, const CaptureInterface& interface) const {
  constexpr std::int64_t kLastSecond = std::numeric_limits<std::int64_t>::max() / 2'000'000;
  std::uint64_t units = interface.units;
  const auto seconds = static_cast<std::int64_t>(std::min<std::uint64_t>(time / units, kLastSecond));
  std::uint64_t parts = time % units;
  for (; units > std::uint64_t{1} << 43U; units >>= 1U) parts >>= 1U;
  const std::int64_t offset = std::clamp(interface.offset_s, -kLastSecond, kLastSecond);
  return (seconds + offset) * std::int64_t{kMicros} + static_cast<std::int64_t>(parts * kMicros / units);
}

std::optional<std::uint32_t> first_link_type(std::string_view head) {
  Evidence evidence = Evidence::of("", head);
  auto reader = CaptureReader::open(evidence, [](const std::string&) {});
  if (!reader) return std::nullopt;
  if (reader->interfaces().empty()) static_cast<void>(reader->next());
  if (reader->interfaces().empty()) return std::nullopt;
  return reader->interfaces().front().link_type;
}

bool is_pcapng(std::string_view head) { return head.starts_with("\n\r\r\n"); }

}  // namespace porttape
