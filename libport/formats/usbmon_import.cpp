#include <fmt/format.h>
#include <map>
#include <utility>

#include "libport/formats/capture_reader.hpp"
#include "libport/formats/tape_wall.hpp"
#include "libport/formats/usb_device_choice.hpp"
#include "libport/formats/usbmon_format.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostSetups = 65'536;

bool is_usbmon(std::uint32_t link_type) {
  return link_type == UsbUrb::kShortHead || link_type == UsbUrb::kLongHead;
}

class UsbmonImport {
 public:
  UsbmonImport(Evidence& from, ImportTape& to) : from_(from), to_(to) { to.keep_order(); }

  Result<std::optional<TapeTime>> run(const ConvertProgress& progress) {
    auto reader = CaptureReader::open(from_, [this](std::string text) { to_.problem(std::move(text)); });
    if (!reader) return reader.error();
    Result<UsbDeviceChoice> choice = UsbDeviceChoice::of(to_.options().device.value_or(""));
    if (!choice) return choice.error();
    choice_ = std::move(*choice);
    for (;;) {
      const auto next = reader->next();
      if (!next) return next.error();
      if (!*next) break;
      const std::uint32_t type = reader->interfaces()[(*next)->interface].link_type;
      if (!is_usbmon(type)) continue;
      has_usb_ = true;
      if (Result<void> taken = take(**next, UsbUrb::parse(type, (*next)->data, reader->endian())); !taken)
        return taken.error();
      if (progress) progress(from_.offset());
    }
    if (!adapter_) return none();
    if (Result<void> ended = adapter_->until(at_); !ended) return ended.error();
    return reader->torn() ? std::optional<TapeTime>{} : std::optional(to_.latest());
  }

 private:
  [[nodiscard]] Error none() const {
    if (!has_usb_)
      return make_error(Errc::not_a_tape, from_.name() + " has no packets of usbmon (link type 189 or 220)");
    return usage_error(
        fmt::format("{}: no device in it is known for a serial adapter; say it by --device BUS.ADDRESS,KIND. "
                    "With bulk transfers: {}",
                    from_.name(), choice_.devices()));
  }

  Result<void> take(const CapturePacket& packet, const std::optional<UsbUrb>& urb) {
    if (!urb) {
      if (!std::exchange(told_short_, true))
        to_.problem(from_.error_at(packet.offset, "a packet without usbmon's head, or of an error; left out")
                        .message);
      return {};
    }
    const auto setup = setup_of(*urb);
    choice_.see(*urb, setup);
    const auto kind = choice_.kind(*urb);
    if (!kind) return {};
    const std::int64_t us = packet.us.value_or(zero_us_.value_or(0));
    if (!adapter_) {
      adapter_.emplace(to_, *kind);
      adapter_->port(choice_.port());
      if (const std::string guess = choice_.guess(*urb); !guess.empty()) to_.guessed(guess);
      choice_.take(*urb);
    }
    adapter_->packet_size(choice_.packet_size(*urb));
    adapter_->version(choice_.version(*urb));
    if (!zero_us_) {
      if (!adapter_->tells(*urb, setup)) return {};
      zero_us_ = us;
      to_.wall_of_zero(wall_text(Micros(us)));
      if (Result<void> opened = to_.event(TapeTime{}, event::Open{}); !opened) return opened;
    }
    std::int64_t since = 0;
    if (__builtin_sub_overflow(us, *zero_us_, &since)) since = 0;
    at_ = tape_time_us(since);
    return adapter_->take(at_, *urb, setup);
  }

  // Of a transfer that is done: the one that it was submitted with.
  std::optional<UsbUrb::Setup> setup_of(const UsbUrb& urb) {
    if (urb.transfer != UsbUrb::Transfer::control) return std::nullopt;
    if (urb.submitted) {
      if (urb.setup && pending_.size() < kMostSetups) pending_[urb.id] = *urb.setup;
      return urb.setup;
    }
    const auto found = pending_.extract(urb.id);
    return found.empty() ? std::nullopt : std::optional(found.mapped());
  }

  Evidence& from_;
  ImportTape& to_;
  UsbDeviceChoice choice_;
  std::optional<UsbAdapter> adapter_;
  std::map<std::uint64_t, UsbUrb::Setup> pending_;
  std::optional<std::int64_t> zero_us_;
  TapeTime at_{};
  bool has_usb_ = false;
  bool told_short_ = false;
};

}  // namespace

Result<std::optional<TapeTime>> import_usbmon(Evidence& from, ImportTape& to,
                                              const ConvertProgress& progress) {
  return UsbmonImport(from, to).run(progress);
}

int detect_usbmon(std::string_view head) {
  const auto type = first_link_type(head);
  return type && is_usbmon(*type) ? 100 : 0;
}

}  // namespace porttape
