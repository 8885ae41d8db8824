#include "libport/formats/usb_device_choice.hpp"

#include <algorithm>
#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

constexpr std::uint8_t kFromDevice = 0x80;
constexpr std::uint8_t kGetDescriptor = 6;
constexpr std::size_t kMostDevices = 4096;
constexpr std::size_t kMostTold = 20;

// A packet of FTDI's begins with the states of modem and line: 1 in the first four bits, and what is empty.
bool is_ftdi_packet(ByteView data) {
  return data.size() >= 2 && (data[0] & 0x0fU) == 0x01 && (data[1] & 0x9fU) == 0 && (data[1] & 0x60U) == 0x60;
}

}  // namespace

Result<UsbDeviceChoice> UsbDeviceChoice::of(std::string_view text) {
  UsbDeviceChoice choice;
  while (!text.empty()) {
    const std::string_view part = text.substr(0, text.find(','));
    text.remove_prefix(std::min(part.size() + 1, text.size()));
    const std::size_t dot = part.find('.');
    if (const auto kind = usb_adapter_named(part)) {
      choice.named_kind_ = kind;
    } else if (part.starts_with("port=")) {
      choice.port_ = whole_number<std::uint8_t>(part.substr(5)).value_or(0);
      if (choice.port_ == 0 || choice.port_ > 7) return usage_error("option 'device': a port is 1 to 7");
    } else {
      const auto bus = whole_number<std::uint16_t>(part.substr(0, dot));
      const auto address =
          dot == std::string_view::npos ? std::nullopt : whole_number<std::uint8_t>(part.substr(dot + 1));
      if (!bus || !address)
        return usage_error(fmt::format(
            "option 'device': {} is wrong; of USB it is BUS.ADDRESS, the kind cdc, ftdi, cp210x or "
            "pl2303, port=N of several, or more of them: 1.5,ftdi",
            in_quotes(part)));
      choice.bus_address_ = Place(*bus, *address);
    }
  }
  return choice;
}

std::string UsbDeviceChoice::text(const Place& place) {
  return fmt::format("{}.{}", place.first, place.second);
}

const UsbDeviceChoice::Device* UsbDeviceChoice::find(const UsbUrb& urb) const {
  const auto found = devices_.find(place(urb));
  return found == devices_.end() ? nullptr : &found->second;
}

void UsbDeviceChoice::see(const UsbUrb& urb, const std::optional<UsbUrb::Setup>& setup) {
  if (devices_.size() == kMostDevices && find(urb) == nullptr) return;
  Device& device = devices_[place(urb)];
  if (urb.transfer == UsbUrb::Transfer::bulk) {
    device.has_bulk |= !urb.data.empty();
    if (!device.kind && urb.in && !urb.submitted && is_ftdi_packet(urb.data)) {
      device.kind = UsbAdapterKind::ftdi;
      device.guessed = true;
    }
  }
  if (!setup) return;
  if (!urb.submitted) return see_descriptor(device, urb, *setup);
  const auto by_request = usb_adapter_of(*setup);
  if (!by_request || device.kind) return;
  device.kind = by_request;
  device.guessed = by_request == UsbAdapterKind::ftdi;  // vendors' requests are anyone's
}

void UsbDeviceChoice::see_descriptor(Device& device, const UsbUrb& urb, const UsbUrb::Setup& setup) {
  if (setup.type != kFromDevice || setup.request != kGetDescriptor) return;
  const unsigned what = setup.value >> 8U;
  if (what == 1 && urb.data.size() >= 14) {
    // An address that was given anew may be another device's.
    device.kind = usb_adapter_of(number_in<std::uint16_t>(urb.data, 8, Endian::little));
    device.version = number_in<std::uint16_t>(urb.data, 12, Endian::little);
    device.guessed = false;
  }
  if (what != 2) return;
  for (ByteView left = urb.data; left.size() >= 2 && left[0] >= 2 && left[0] <= left.size();
       left = left.subspan(left[0])) {
    const bool is_interface = left[1] == 4 && left[0] >= 9;
    if (is_interface && left[5] == 2 && left[6] == 2 && !device.kind) device.kind = UsbAdapterKind::cdc_acm;
    const bool is_bulk_in = left[1] == 5 && left[0] >= 7 && (left[2] & 0x80U) != 0 && (left[3] & 3U) == 2;
    if (is_bulk_in) device.packet_size = number_in<std::uint16_t>(left, 4, Endian::little);
  }
}

std::optional<UsbAdapterKind> UsbDeviceChoice::kind(const UsbUrb& urb) const {
  if (bus_address_ && *bus_address_ != place(urb)) return std::nullopt;
  const Device* const device = find(urb);
  const auto seen = device == nullptr ? std::nullopt : device->kind;
  if (named_kind_) return bus_address_ || seen == named_kind_ ? named_kind_ : std::nullopt;
  if (seen) return seen;
  return bus_address_ && device != nullptr && device->has_bulk ? std::optional(UsbAdapterKind::cdc_acm)
                                                               : std::nullopt;
}

std::size_t UsbDeviceChoice::packet_size(const UsbUrb& urb) const {
  constexpr std::size_t kFull = 64;
  constexpr std::size_t kHigh = 512;
  const Device* const device = find(urb);
  if (device == nullptr) return kFull;
  if (device->packet_size >= 8) return device->packet_size;
  return device->version >= 0x0700 && device->version != 0x1000 ? kHigh : kFull;
}

std::uint16_t UsbDeviceChoice::version(const UsbUrb& urb) const {
  const Device* const device = find(urb);
  return device == nullptr ? 0 : device->version;
}

std::string UsbDeviceChoice::guess(const UsbUrb& urb) const {
  const Device* const device = find(urb);
  if (named_kind_ || device == nullptr || (device->kind && !device->guessed)) return {};
  const std::string_view why = device->kind ? ", by what is sent to and fro" : ", which nothing tells";
  return fmt::format("device {} is a serial adapter of kind {}{}; --device {},KIND says another",
                     text(place(urb)), name_of(device->kind.value_or(UsbAdapterKind::cdc_acm)), why,
                     text(place(urb)));
}

std::string UsbDeviceChoice::devices() const {
  std::string all;
  std::size_t told = 0;
  for (const auto& [place, device] : devices_) {
    if (!device.has_bulk || ++told > kMostTold) continue;
    all += (all.empty() ? "" : ", ") + text(place);
  }
  return all.empty() ? "none" : all;
}

}  // namespace porttape
