#include "libport/formats/usb_adapter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace porttape {
namespace {

using Kind = UsbAdapterKind;
using Transfer = UsbUrb::Transfer;

constexpr std::uint8_t kToClass = 0x21;
constexpr std::uint8_t kToVendor = 0x40;
constexpr std::uint8_t kToVendorInterface = 0x41;
constexpr std::uint8_t kFromVendorInterface = 0xc1;

struct KindName {
  Kind kind;
  std::string_view name;
  std::uint16_t vendor;  // 0: many
};
constexpr std::array<KindName, 4> kKinds = {{{Kind::cdc_acm, "cdc", 0},
                                             {Kind::ftdi, "ftdi", 0x0403},
                                             {Kind::cp210x, "cp210x", 0x10c4},
                                             {Kind::pl2303, "pl2303", 0x067b}}};

std::optional<Parity> parity_of(unsigned code) {
  constexpr std::array kCodes = {Parity::none, Parity::odd, Parity::even, Parity::mark, Parity::space};
  return code < kCodes.size() ? std::optional(kCodes.at(code)) : std::nullopt;
}

std::optional<unsigned> stop_bits_of(unsigned code) {
  return code > 2 ? std::nullopt : std::optional(code == 0 ? 1U : 2U);
}

std::optional<unsigned> data_bits_of(unsigned bits) {
  return bits >= 5 && bits <= 8 ? std::optional(bits) : std::nullopt;
}

// What divisors give is near the rate that the driver wanted.
unsigned usual_rate(double rate) {
  constexpr std::array kUsual = {300U,       600U,       1'200U,    1'800U,   2'400U,     4'800U,
                                 9'600U,     19'200U,    38'400U,   57'600U,  115'200U,   230'400U,
                                 460'800U,   500'000U,   576'000U,  921'600U, 1'000'000U, 1'152'000U,
                                 1'500'000U, 2'000'000U, 3'000'000U};
  for (const unsigned usual : kUsual) {
    if (std::abs(rate / usual - 1) < 0.02) return usual;
  }
  return static_cast<unsigned>(std::lround(rate));
}

}  // namespace

std::string_view name_of(UsbAdapterKind kind) {
  for (const KindName& each : kKinds) {
    if (each.kind == kind) return each.name;
  }
  return {};
}

std::optional<UsbAdapterKind> usb_adapter_named(std::string_view name) {
  for (const KindName& each : kKinds) {
    if (each.name == name) return each.kind;
  }
  return std::nullopt;
}

std::optional<UsbAdapterKind> usb_adapter_of(std::uint16_t vendor) {
  for (const KindName& each : kKinds) {
    if (each.vendor == vendor && vendor != 0) return each.kind;
  }
  return std::nullopt;
}

std::optional<UsbAdapterKind> usb_adapter_of(const UsbUrb::Setup& setup) {
  if (setup.type == kToClass && setup.request >= 0x20 && setup.request <= 0x23) return Kind::cdc_acm;
  if (setup.type == kToVendorInterface && (setup.request == 0x00 || setup.request == 0x1e))
    return Kind::cp210x;
  // SET_BAUD_RATE and SET_LATENCY_TIMER.
  if (setup.type == kToVendor && (setup.request == 3 || setup.request == 9)) return Kind::ftdi;
  return std::nullopt;
}

bool UsbAdapter::tells(const UsbUrb& urb, const std::optional<UsbUrb::Setup>& setup) const {
  if (urb.transfer == Transfer::bulk) return !urb.data.empty();
  if (urb.transfer != Transfer::control || !setup) return false;
  if (kind_ == Kind::cp210x) return setup->type == kToVendorInterface;
  if (kind_ == Kind::ftdi) return setup->type == kToVendor;
  return setup->type == kToClass;
}

Result<void> UsbAdapter::until(TapeTime at) {
  if (!break_ends_ || *break_ends_ > at) return {};
  at_ = *std::exchange(break_ends_, std::nullopt);
  return line_break(Side::driver, false);
}

Result<void> UsbAdapter::take(TapeTime at, const UsbUrb& urb, const std::optional<UsbUrb::Setup>& setup) {
  if (Result<void> ended = until(at); !ended) return ended;
  at_ = at;
  if (urb.transfer == Transfer::bulk) return bulk(urb);
  if (urb.transfer == Transfer::interrupt)
    return urb.in && !urb.submitted ? notification(urb.data) : Result<void>();
  if (urb.transfer != Transfer::control || !setup) return {};
  const bool asked = setup->type == kFromVendorInterface && kind_ == Kind::cp210x && !urb.submitted;
  if (asked && setup->request == 0x08 && !urb.data.empty()) {
    const unsigned state = urb.data.front();
    return inputs({(state & 0x10U) != 0, (state & 0x20U) != 0, (state & 0x80U) != 0, (state & 0x40U) != 0},
                  true);
  }
  if (!urb.submitted) return {};
  if (kind_ == Kind::ftdi) return setup->type == kToVendor ? ftdi_request(*setup) : Result<void>();
  if (kind_ == Kind::cp210x)
    return setup->type == kToVendorInterface ? cp210x_request(*setup, urb.data) : Result<void>();
  return setup->type == kToClass ? cdc_request(*setup, urb.data) : Result<void>();
}

Result<void> UsbAdapter::bulk(const UsbUrb& urb) {
  // Bytes out are in what is submitted, bytes in in what is done.
  if (urb.data.empty() || urb.in == urb.submitted) return {};
  const bool is_ftdi = kind_ == Kind::ftdi;
  if (is_ftdi && urb.endpoint != (urb.in ? 2 * port_ - 1 : 2 * port_)) return {};
  if (urb.data.size() < urb.length)
    to_.problem("the capture has not kept all bytes of each transfer; take one with a larger snap length");
  if (urb.in && is_ftdi) return ftdi_packets(urb.data);
  return to_.block(urb.in ? Direction::read : Direction::write, at_, urb.data);
}

Result<void> UsbAdapter::ftdi_packets(ByteView data) {
  Bytes bytes;
  while (data.size() >= 2) {
    const ByteView packet = data.first(std::min(data.size(), packet_size_));
    const unsigned state = packet[0];
    const Result<void> told = inputs(
        {(state & 0x10U) != 0, (state & 0x20U) != 0, (state & 0x80U) != 0, (state & 0x40U) != 0}, true);
    if (!told) return told;
    const bool broken = (packet[1] & 0x10U) != 0;
    if (Result<void> broke = line_break(Side::device, broken); !broke) return broke;
    append(bytes, packet.subspan(2));
    data = data.subspan(packet.size());
  }
  return bytes.empty() ? Result<void>() : to_.block(Direction::read, at_, bytes);
}

Result<void> UsbAdapter::cdc_request(const UsbUrb::Setup& setup, ByteView data) {
  constexpr std::uint16_t kUntilEnded = 0xffff;
  switch (setup.request) {
    case 0x20:  // SET_LINE_CODING
      if (data.size() < 7) return {};
      return settings({.baud = number_in<std::uint32_t>(data, 0, Endian::little),
                       .data_bits = data_bits_of(data[6]),
                       .parity = parity_of(data[5]),
                       .stop_bits = stop_bits_of(data[4])});
    case 0x22:  // SET_CONTROL_LINE_STATE
      return outputs((setup.value & 1U) != 0, (setup.value & 2U) != 0);
    case 0x23:  // SEND_BREAK
      if (setup.value != 0 && setup.value != kUntilEnded)
        break_ends_ = at_ + std::chrono::milliseconds(setup.value);
      return line_break(Side::driver, setup.value != 0);
    default:
      return {};
  }
}

Result<void> UsbAdapter::ftdi_request(const UsbUrb::Setup& setup) {
  switch (setup.request) {
    case 0:  // RESET
      return setup.value == 1 || setup.value == 2 ? flush(setup.value == 1, setup.value == 2)
                                                  : Result<void>();
    case 1: {  // SET_MODEM_CTRL
      const auto told = [&](unsigned bit) {
        return (setup.value & bit << 8U) != 0 ? std::optional((setup.value & bit) != 0) : std::nullopt;
      };
      return outputs(told(1), told(2));
    }
    case 2:  // SET_FLOW_CTRL
      return settings({.hw_flow = (setup.index >> 8U & 1U) != 0, .sw_flow = (setup.index >> 8U & 4U) != 0});
    case 3:  // SET_BAUD_RATE
      return settings({.baud = ftdi_baud(setup)});
    case 4: {  // SET_DATA
      const Result<void> told = settings({.data_bits = data_bits_of(setup.value & 0xffU),
                                          .parity = parity_of(setup.value >> 8U & 7U),
                                          .stop_bits = stop_bits_of(setup.value >> 11U & 7U)});
      return told ? line_break(Side::driver, (setup.value >> 14U & 1U) != 0) : told;
    }
    default:
      return {};
  }
}

// A divisor in eighths; chips of several ports, and fast ones, have its highest bits one byte further up.
unsigned UsbAdapter::ftdi_baud(const UsbUrb::Setup& setup) const {
  constexpr std::array kEighths = {0U, 4U, 2U, 1U, 3U, 5U, 6U, 7U};
  const bool has_ports = version_ == 0x0500 || (version_ >= 0x0700 && version_ != 0x1000);
  const unsigned high = has_ports || setup.index > 0xff ? setup.index >> 8U : setup.index & 1U;
  const bool fast = (high & 2U) != 0;
  unsigned eighths = (setup.value & 0x3fffU) * 8 + kEighths.at(setup.value >> 14U | (high & 1U) << 2U);
  if (setup.value == 0) eighths = 8;
  if (setup.value == 1 && (high & 1U) == 0) eighths = 12;
  return usual_rate((fast ? 96e6 : 24e6) / eighths);
}

Result<void> UsbAdapter::cp210x_request(const UsbUrb::Setup& setup, ByteView data) {
  constexpr double kClock = 3'686'400;
  switch (setup.request) {
    case 0x00:  // IFC_ENABLE
      if (std::exchange(open_, setup.value != 0) == (setup.value != 0)) return {};
      return open_ ? to_.event(at_, event::Open{}) : to_.event(at_, event::Close{});
    case 0x01:  // SET_BAUDDIV
      return setup.value == 0 ? Result<void>() : settings({.baud = usual_rate(kClock / setup.value)});
    case 0x03:  // SET_LINE_CTL
      return settings({.data_bits = data_bits_of(setup.value >> 8U),
                       .parity = parity_of(setup.value >> 4U & 0xfU),
                       .stop_bits = stop_bits_of(setup.value & 0xfU)});
    case 0x05:  // SET_BREAK
      return line_break(Side::driver, setup.value != 0);
    case 0x07: {  // SET_MHS
      const auto told = [&](unsigned bit) {
        return (setup.value & bit << 8U) != 0 ? std::optional((setup.value & bit) != 0) : std::nullopt;
      };
      return outputs(told(1), told(2));
    }
    case 0x12:  // PURGE
      return flush((setup.value & 0xaU) != 0, (setup.value & 0x5U) != 0);
    case 0x13:  // SET_FLOW
      if (data.size() < 8) return {};
      return settings({.hw_flow = (data[0] & 0x08U) != 0, .sw_flow = (data[4] & 0x03U) != 0});
    case 0x1e:  // SET_BAUDRATE
      if (data.size() < 4) return {};
      return settings({.baud = number_in<std::uint32_t>(data, 0, Endian::little)});
    default:
      return {};
  }
}

// SERIAL_STATE of CDC, and what PL2303 has in its place.
Result<void> UsbAdapter::notification(ByteView data) {
  if (data.size() < 9 || data[0] != 0xa1 || data[1] != 0x20) return {};
  if (kind_ != Kind::cdc_acm && kind_ != Kind::pl2303) return {};
  const unsigned state = data[8];
  const bool has_cts = kind_ == Kind::pl2303;
  const Inputs now{has_cts && (state & 0x80U) != 0, (state & 2U) != 0, (state & 1U) != 0, (state & 8U) != 0};
  if (Result<void> told = inputs(now, has_cts); !told) return told;
  return line_break(Side::device, (state & 4U) != 0);
}

Result<void> UsbAdapter::settings(const SeenSettings& line) {
  const SeenSettings now = line.over(line_);
  if (now == line_) return {};
  line_ = now;
  return to_.event(at_, event::Settings{Side::driver, now, SettingsOrder::exact});
}

Result<void> UsbAdapter::outputs(std::optional<bool> dtr, std::optional<bool> rts) {
  if (dtr && std::exchange(dtr_, *dtr) != *dtr) {
    if (Result<void> told = signal(Side::driver, LineSignal::Name::dtr, *dtr); !told) return told;
  }
  if (rts && std::exchange(rts_, *rts) != *rts) return signal(Side::driver, LineSignal::Name::rts, *rts);
  return {};
}

Result<void> UsbAdapter::inputs(const Inputs& now, bool has_cts) {
  const std::optional<Inputs> before = std::exchange(inputs_, now);
  using Name = LineSignal::Name;
  struct Change {
    Name name;
    bool Inputs::*line;
  };
  for (const Change& each : {Change{Name::cts, &Inputs::cts}, Change{Name::dsr, &Inputs::dsr},
                             Change{Name::cd, &Inputs::cd}, Change{Name::ri, &Inputs::ri}}) {
    const bool known = each.name != Name::cts || has_cts;
    if (!known || (before && (*before).*each.line == now.*each.line)) continue;
    if (Result<void> told = signal(Side::device, each.name, now.*each.line); !told) return told;
  }
  return {};
}

Result<void> UsbAdapter::signal(Side by, LineSignal::Name name, bool on) {
  return to_.event(at_, signal_event({by, {name, on}}));
}

Result<void> UsbAdapter::line_break(Side by, bool on) {
  bool& now = by == Side::driver ? broken_ : device_broken_;
  return std::exchange(now, on) == on ? Result<void>() : signal(by, LineSignal::Name::brk, on);
}

Result<void> UsbAdapter::flush(bool in, bool out) {
  using Queue = FlushQueue;
  if (!in && !out) return {};
  return to_.event(at_, event::Flush{in && out ? Queue::both : in ? Queue::in : Queue::out});
}

}  // namespace porttape
