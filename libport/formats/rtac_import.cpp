#include <algorithm>
#include <fmt/format.h>
#include <limits>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/formats/capture_choice.hpp"
#include "libport/formats/capture_reader.hpp"
#include "libport/formats/rtac_format.hpp"
#include "libport/formats/rtac_packet.hpp"
#include "libport/formats/tape_wall.hpp"

namespace porttape {
namespace {

using rtac::What;

bool is_rtac(std::uint32_t link_type) { return link_type == rtac::kLinkType; }

// A comment of ours that begins so, whole; nothing: there is none.
template <class Comments>
std::optional<std::string> own_comment(const Comments& comments, std::string_view begin) {
  std::optional<std::string> text;
  for (std::string_view comment : comments) {
    if (text && comment.starts_with(rtac::kAndComment)) {
      *text += comment.substr(rtac::kAndComment.size());
    } else if (text) {
      break;
    } else if (comment.starts_with(begin)) {
      text = comment.substr(begin.size());
    }
  }
  return text;
}

class RtacImport {
 public:
  RtacImport(Evidence& from, ImportTape& to) : from_(from), to_(to), choice_(to.options().device, is_rtac) {}

  Result<std::optional<TapeTime>> run(const ConvertProgress& progress) {
    auto reader = CaptureReader::open(from_, [this](std::string text) { to_.problem(std::move(text)); });
    if (!reader) return reader.error();
    for (;;) {
      const auto next = reader->next();
      if (!next) return next.error();
      if (!*next) break;
      if (!choice_.takes(*reader, **next)) continue;
      if (Result<void> taken = take(*reader, **next); !taken) return taken.error();
      if (progress) progress(from_.offset());
    }
    if (missing_ > 0)
      return from_.error_at(from_.offset(), fmt::format("{} bytes of the last block are missing", missing_));
    return over(*reader);
  }

 private:
  Result<std::optional<TapeTime>> over(const CaptureReader& reader) {
    if (!begun_ && !choice_.found()) {
      if (!choice_.left_out().empty())
        return make_error(Errc::usage,
                          fmt::format("{} has no interface {}; it has {}", from_.name(),
                                      in_quotes(*to_.options().device), in_quotes(choice_.left_out())));
      if (!choice_.other_types().empty())
        return make_error(Errc::not_a_tape,
                          fmt::format("{} has no packets of link type 250 (RTAC serial), but of {}",
                                      from_.name(), choice_.other_types()));
      if (reader.interfaces().empty() || !is_rtac(reader.interfaces().front().link_type))
        return make_error(Errc::not_a_tape, from_.name() + " has no packets");
    }
    if (!begun_) {
      if (Result<void> begun = begin(reader, nullptr); !begun) return begun.error();
    }
    if (Result<void> ended = end_break(to_.latest()); !ended) return ended.error();
    if (!choice_.left_out().empty())
      to_.guessed(fmt::format("of several interfaces {} is taken, not {}; --device NAME takes another",
                              in_quotes(choice_.taken()), in_quotes(choice_.left_out())));
    if (ours_ || reader.torn()) return end_;
    return std::optional(to_.latest());
  }

  Result<void> begin(const CaptureReader& reader, const CapturePacket* first) {
    begun_ = true;
    to_.sure();
    const auto first_us = first != nullptr ? first->us : std::nullopt;
    zero_us_ = first_us.value_or(0);
    // Of the packet, which nobody changes: mergecap adds to the section's.
    const auto own = [&](std::string_view comment) {
      const auto text = first != nullptr ? own_comment(first->comments, comment) : std::nullopt;
      return text ? text : own_comment(reader.section_comments(), comment);
    };
    if (const auto zero = own(rtac::kZeroComment)) {
      const auto us = whole_number<std::int64_t>(*zero);
      if (us) zero_us_ = *us;
      ours_ = us.has_value();
    }
    if (!ours_) {
      to_.keep_order();
      if (first_us) to_.wall_of_zero(wall_text(Micros(zero_us_)));
      return to_.event(TapeTime{}, event::Open{});
    }
    const auto header = own(rtac::kHeaderComment);
    if (!header) return {};
    const Result<void> taken = to_.header_line(*header);
    if (!taken) to_.problem("the header in the comments is none: " + taken.error().message);
    return {};
  }

  Result<void> take(const CaptureReader& reader, const CapturePacket& packet) {
    if (!begun_) {
      if (Result<void> begun = begin(reader, &packet); !begun) return begun;
    }
    if (packet.data.size() < rtac::kHead) {
      to_.problem(wrong(packet, "a packet without the head of RTAC serial; it is left out").message);
      return {};
    }
    if (packet.us) {
      std::int64_t us = 0;
      if (__builtin_sub_overflow(*packet.us, zero_us_, &us)) us = std::numeric_limits<std::int64_t>::max();
      at_ = tape_time_us(us);
    } else {
      to_.guessed("packets without a time came with the one before");
    }
    const ByteView bytes = packet.data.subspan(rtac::kHead);
    const Result<void> put = ours_ ? take_own(packet, bytes) : take_foreign(packet, bytes);
    if (!put && put.error().code == Errc::usage) return wrong(packet, put.error().message);
    return put;
  }

  Result<void> take_own(const CapturePacket& packet, ByteView bytes) {
    const bool more = own_comment(packet.comments, rtac::kMoreComment).has_value();
    if (more != (missing_ > 0))
      return wrong(packet, more ? "bytes of a block whose begin is missing"
                                : fmt::format("{} bytes of the block before are missing", missing_));
    if (more) return add_more(packet, bytes);
    if (const auto line = own_comment(packet.comments, rtac::kEventComment)) return take_event(packet, *line);
    const What what = what_of(packet);
    if (what != What::tx_start && what != What::rx_start) return take_foreign(packet, bytes);
    const Direction direction = what == What::rx_start ? Direction::read : Direction::write;
    if (const auto text = own_comment(packet.comments, rtac::kLengthComment)) {
      const auto length = whole_number<std::uint32_t>(*text);
      if (!length || *length < bytes.size()) return wrong(packet, "a block of a length that cannot be");
      missing_ = *length - static_cast<std::uint32_t>(bytes.size());
      if (Result<void> begun = to_.begin_block(direction, at_, *length); !begun) return begun;
      return bytes.empty() ? Result<void>() : to_.add(bytes);
    }
    return to_.block(direction, at_, bytes);
  }

  Result<void> add_more(const CapturePacket& packet, ByteView bytes) {
    if (bytes.size() > missing_) return wrong(packet, "more bytes than the block has");
    missing_ -= static_cast<std::uint32_t>(bytes.size());
    return to_.add(bytes);
  }

  Result<void> take_event(const CapturePacket& packet, const std::string& line) {
    const auto event = decode_event(line);
    if (!event) {
      to_.problem(wrong(packet, "an event that is none, left out: " + event.error().message).message);
      return {};
    }
    if (std::holds_alternative<event::End>(event->what)) {
      end_ = at_;
      return {};
    }
    return to_.event_line(at_, line);
  }

  Result<void> take_foreign(const CapturePacket& packet, ByteView bytes) {
    if (packet.data.size() < packet.length)
      to_.problem(wrong(packet, fmt::format("{} of the packet's {} bytes were kept", packet.data.size(),
                                            packet.length))
                      .message);
    const What what = what_of(packet);
    const std::uint8_t lines = packet.data[9];
    // A status that changes no line ends a break; before all else nobody tells when it ended.
    const bool ends_break = what == What::status_change && lines == lines_.value_or(0) && bytes.empty();
    if (breaking_ && ends_break) return end_break(at_);
    if (Result<void> ended = end_break(to_.latest()); !ended) return ended;
    if (Result<void> told = tell_lines(lines); !told) return told;
    if (Result<void> told = tell(what); !told) return told;
    const bool sent = what == What::tx_start || what == What::tx_end;
    if (bytes.empty()) return {};
    return to_.block(sent ? Direction::write : Direction::read, at_, bytes);
  }

  Result<void> end_break(TapeTime at) {
    if (!std::exchange(breaking_, false)) return {};
    return to_.event(at, event::Break{false, Side::device});
  }

  // What a packet says beside its bytes.
  Result<void> tell(What what) {
    switch (what) {
      case What::data_lost:
        return to_.event(at_, event::Gap{.bytes = 0, .from = at_, .why = "the capture lost data"});
      case What::break_event:
        breaking_ = true;
        return to_.event(at_, event::Break{true, Side::device});
      case What::framing_error:
        return to_.event(at_, event::Mark{"framing error"});
      case What::parity_error:
        return to_.event(at_, event::Mark{"parity error"});
      case What::overflow:
        return to_.event(at_, event::Mark{"overflow"});
      default:
        return {};
    }
  }

  // Lines that nobody watched are all off, and stay it: such a line says nothing.
  Result<void> tell_lines(std::uint8_t state) {
    constexpr std::uint8_t kOpened = rtac::kDtr | rtac::kRts;
    if (!lines_) {
      if (state == 0) return {};
      lines_ = kOpened;
      for (const auto& [bit, name] : rtac::kLines) {
        if ((bit & kOpened) == 0 && (state & bit) == 0) {
          if (Result<void> told = signal(name, false); !told) return told;
        }
      }
    }
    const auto changed = static_cast<std::uint8_t>(state ^ *lines_);
    lines_ = state;
    for (const auto& [bit, name] : rtac::kLines) {
      if ((changed & bit) == 0) continue;
      if (Result<void> told = signal(name, (state & bit) != 0); !told) return told;
    }
    return {};
  }

  Result<void> signal(LineSignal::Name name, bool on) {
    return to_.event(at_, signal_event({is_output(name) ? Side::driver : Side::device, {name, on}}));
  }

  static What what_of(const CapturePacket& packet) { return static_cast<What>(packet.data[8]); }
  [[nodiscard]] Error wrong(const CapturePacket& packet, std::string_view what) const {
    return from_.error_at(packet.offset, what);
  }

  Evidence& from_;
  ImportTape& to_;
  CaptureChoice choice_;
  bool begun_ = false;
  bool ours_ = false;
  std::int64_t zero_us_ = 0;
  TapeTime at_{};
  std::uint32_t missing_ = 0;  // of the block that has begun
  std::optional<std::uint8_t> lines_;
  bool breaking_ = false;
  std::optional<TapeTime> end_;
};

}  // namespace

Result<std::optional<TapeTime>> import_rtac(Evidence& from, ImportTape& to, const ConvertProgress& progress) {
  return RtacImport(from, to).run(progress);
}

int detect_pcapng(std::string_view head) {
  if (!is_pcapng(head)) return 0;
  const auto type = first_link_type(head);
  return type && is_rtac(*type) ? 100 : 50;
}

int detect_rtac(std::string_view head) {
  if (is_pcapng(head)) return 0;
  const auto type = first_link_type(head);
  return type && is_rtac(*type) ? 100 : 0;
}

}  // namespace porttape
