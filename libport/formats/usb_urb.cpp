#include "libport/formats/usb_urb.hpp"

#include <algorithm>

namespace porttape {

std::optional<UsbUrb> UsbUrb::parse(std::uint32_t link_type, ByteView packet, Endian endian) {
  constexpr std::size_t kSetup = 40;
  const std::size_t head = link_type == kLongHead ? 64 : 48;
  if (packet.size() < head || (packet[8] != 'S' && packet[8] != 'C') || packet[9] > 3) return std::nullopt;
  UsbUrb urb;
  urb.id = number_in<std::uint64_t>(packet, 0, endian);
  urb.submitted = packet[8] == 'S';
  urb.transfer = static_cast<Transfer>(packet[9]);
  urb.endpoint = packet[10] & 0x7fU;
  urb.in = (packet[10] & 0x80U) != 0;
  urb.address = packet[11];
  urb.bus = number_in<std::uint16_t>(packet, 12, endian);
  const auto of_urb = number_in<std::uint32_t>(packet, 32, endian);
  const auto kept = number_in<std::uint32_t>(packet, 36, endian);
  if (packet[14] == 0 && urb.transfer == Transfer::control) {
    const ByteView setup = packet.subspan(kSetup, 8);
    urb.setup = Setup{setup[0], setup[1], number_in<std::uint16_t>(setup, 2, Endian::little),
                      number_in<std::uint16_t>(setup, 4, Endian::little)};
  }
  if (packet[15] != 0) return urb;
  urb.data = packet.subspan(head);
  urb.data = urb.data.first(std::min<std::size_t>(urb.data.size(), kept));
  urb.length = std::max(of_urb, static_cast<std::uint32_t>(urb.data.size()));
  return urb;
}

}  // namespace porttape
