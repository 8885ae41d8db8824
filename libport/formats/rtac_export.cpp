#include <algorithm>
#include <fmt/format.h>
#include <iterator>
#include <set>
#include <utility>

#include "libport/base/version.hpp"
#include "libport/formats/capture_writer.hpp"
#include "libport/formats/octets.hpp"
#include "libport/formats/rtac_format.hpp"
#include "libport/formats/rtac_packet.hpp"
#include "libport/formats/tape_wall.hpp"
#include "libport/tape/part_writer.hpp"

namespace porttape {
namespace {

using rtac::What;

constexpr std::size_t kMostOfPacket = 65'536;  // what Wireshark takes is four times as much

// One comment, or several where it is too long for one.
void add_comment(std::vector<std::string>& to, std::string_view begin, std::string_view text) {
  constexpr std::size_t kMost = CaptureWriter::kLongestComment - 100;
  std::string_view word = begin;
  do {
    to.push_back(std::string(word).append(text.substr(0, kMost)));
    text.remove_prefix(std::min(text.size(), kMost));
    word = rtac::kAndComment;
  } while (!text.empty());
}

class RtacExport {
 public:
  // The comments are the first packet's, beside its own.
  RtacExport(CaptureWriter& to, std::uint64_t zero, std::vector<std::string> first_comments = {})
      : to_(to), zero_(zero), first_comments_(std::move(first_comments)) {}

  Result<void> run(TapeReader& from, const ConvertProgress& progress) {
    std::uint64_t bytes = 0;
    for (;;) {
      const auto next = from.next();
      if (!next) return next.error();
      if (!*next) break;
      if (Result<void> added = (*next)->event != nullptr ? event(**next) : piece(**next); !added)
        return added;
      if (progress) progress(bytes += bytes_in_file(**next));
    }
    see_break(std::nullopt);
    return {};
  }

  [[nodiscard]] bool cut_blocks() const { return cut_; }
  [[nodiscard]] bool empty_blocks() const { return empty_; }
  [[nodiscard]] bool breaks_of_driver() const { return breaks_of_driver_; }
  // That cannot be told when they end, since something else comes first.
  [[nodiscard]] bool breaks_without_end() const { return breaks_without_end_; }
  [[nodiscard]] const std::set<std::string, std::less<>>& events() const { return events_; }

 private:
  // Of each record: on or off, nothing where it is no break.
  void see_break(std::optional<TapedSignal> signal) {
    const bool is_break = signal && signal->signal.name == LineSignal::Name::brk;
    const bool ends = is_break && !signal->signal.on;
    if (breaking_ != ends) breaks_without_end_ = true;
    breaking_ = is_break && signal->signal.on;
    if (is_break && signal->by == Side::driver) breaks_of_driver_ = true;
  }

  Result<void> event(const Record& record) {
    What what = What::status_change;
    see_break(signal_of(*record.event));
    if (std::holds_alternative<event::Open>(*record.event)) {
      lines_ |= rtac::kDtr | rtac::kRts;
      events_.emplace(name_of(*record.event));
    } else if (std::holds_alternative<event::Close>(*record.event)) {
      lines_ &= static_cast<std::uint8_t>(~(rtac::kDtr | rtac::kRts));
      events_.emplace(name_of(*record.event));
    } else if (const auto signal = signal_of(*record.event)) {
      if (signal->signal.name == LineSignal::Name::brk && signal->signal.on) what = What::break_event;
      for (const auto& [bit, name] : rtac::kLines) {
        if (name == signal->signal.name)
          lines_ = static_cast<std::uint8_t>(signal->signal.on ? lines_ | bit : lines_ & ~bit);
      }
    } else if (std::holds_alternative<event::Gap>(*record.event)) {
      what = What::data_lost;
    } else if (std::holds_alternative<event::End>(*record.event)) {
      what = What::complete;
    } else {
      events_.emplace(name_of(*record.event));
    }
    PacketToWrite packet;
    add_comment(packet.comments, rtac::kEventComment, record.event_line);
    return add(what, record.at, packet);
  }

  Result<void> piece(const Record& record) {
    see_break(std::nullopt);
    ByteView left = record.data;
    std::size_t offset = record.piece_offset;
    do {
      PacketToWrite packet;
      packet.data = left.first(std::min(left.size(), kMostOfPacket));
      packet.way = record.kind == RecordKind::read ? CaptureWay::inbound : CaptureWay::outbound;
      const bool whole = packet.data.size() == record.block_length;
      if (offset > 0) {
        packet.comments.emplace_back(rtac::kMoreComment);
      } else if (!whole || packet.data.empty()) {
        packet.comments.push_back(fmt::format("{}{}", rtac::kLengthComment, record.block_length));
      }
      cut_ |= !whole;
      empty_ |= packet.data.empty();
      const What what = record.kind == RecordKind::read ? What::rx_start : What::tx_start;
      if (Result<void> added = add(what, record.at, packet); !added) return added;
      offset += packet.data.size();
      left = left.subspan(packet.data.size());
    } while (!left.empty());
    return {};
  }

  Result<void> add(What what, TapeTime at, PacketToWrite& packet) {
    constexpr std::uint64_t kSecond = 1'000'000;
    packet.us = zero_ + static_cast<std::uint64_t>(to_us(at));
    std::string head;
    add_number(head, static_cast<std::uint32_t>(packet.us / kSecond), Endian::big);
    add_number(head, static_cast<std::uint32_t>(packet.us % kSecond), Endian::big);
    head += static_cast<char>(what);
    head += static_cast<char>(lines_);
    head.append(2, '\0');
    packet.head = head;
    std::ranges::move(std::exchange(first_comments_, {}), std::back_inserter(packet.comments));
    return to_.add(packet);
  }

  CaptureWriter& to_;
  std::uint64_t zero_;
  std::vector<std::string> first_comments_;  // not written yet
  std::uint8_t lines_ = 0;
  bool cut_ = false;
  bool empty_ = false;
  bool breaking_ = false;
  bool breaks_of_driver_ = false;
  bool breaks_without_end_ = false;
  std::set<std::string, std::less<>> events_;  // that only a comment tells
};

std::string hardware_of(const TapeHeader& header) {
  if (!header.identity) return {};
  const PortIdentity& identity = *header.identity;
  std::string text = identity.manufacturer;
  for (const std::string* part : {&identity.product, &identity.serial}) {
    if (!part->empty()) text += (text.empty() ? "" : " ") + *part;
  }
  return text;
}

}  // namespace

Result<std::vector<std::string>> export_pcapng(TapeReader& from, NewFile& to,
                                               const ConvertProgress& progress) {
  const std::optional<TapeHeader> header = from.header();
  const std::uint64_t zero = wall_us_of_zero(header);
  PcapngWriter writer(to);
  PcapngWriter::Section section;
  section.link_type = rtac::kLinkType;
  section.program = "porttape " + std::string(version());
  section.interface = "tape";
  section.comments.push_back(fmt::format("{}{}", rtac::kZeroComment, zero));
  if (header) {
    if (!header->tool.empty()) section.program = header->tool.raw();
    if (!header->device.empty()) section.interface = header->device.raw();
    section.hardware = hardware_of(*header);
    section.os = header->host.raw();
    add_comment(section.comments, rtac::kHeaderComment, from.header_line());
  }
  if (Result<void> begun = writer.begin(section); !begun) return begun.error();
  if (Result<void> done = RtacExport(writer, zero, section.comments).run(from, progress); !done)
    return done.error();
  return std::vector<std::string>{};
}

Result<std::vector<std::string>> export_rtac(TapeReader& from, NewFile& to, const ConvertProgress& progress) {
  PcapWriter writer(to);
  if (Result<void> begun = writer.begin(rtac::kLinkType); !begun) return begun.error();
  RtacExport out(writer, wall_us_of_zero(from.header()));
  if (Result<void> done = out.run(from, progress); !done) return done.error();
  std::vector<std::string> lost{"the header"};
  if (out.empty_blocks()) lost.emplace_back("empty blocks");
  if (out.cut_blocks()) lost.emplace_back("where blocks of more than 65536 bytes begin and end");
  if (out.breaks_of_driver()) lost.emplace_back("that breaks are the driver's");
  if (out.breaks_without_end()) lost.emplace_back("when a break ends that something else comes in");
  for (const std::string& name : out.events()) lost.push_back("what the " + name + " events say");
  return lost;
}

}  // namespace porttape
