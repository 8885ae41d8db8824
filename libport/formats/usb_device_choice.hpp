#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "libport/formats/usb_adapter.hpp"

namespace porttape {

// Which of the devices on a captured bus is the serial adapter, and of what kind: the one that the user
// names, else the first that is known for one by its descriptors, the requests made of it, or its bytes.
class UsbDeviceChoice {
 public:
  // "1.5", "1.5,ftdi", "1.5,ftdi,port=2", "ftdi". Errc::usage.
  static Result<UsbDeviceChoice> of(std::string_view text);

  // What is learned of the transfer's device.
  void see(const UsbUrb& urb, const std::optional<UsbUrb::Setup>& setup);
  // The adapter's kind; nothing: it is another device, or not known for an adapter (yet).
  [[nodiscard]] std::optional<UsbAdapterKind> kind(const UsbUrb& urb) const;
  // It is taken: no other one is any more.
  void take(const UsbUrb& urb) { bus_address_ = place(urb); }

  [[nodiscard]] std::size_t packet_size(const UsbUrb& urb) const;
  [[nodiscard]] std::uint16_t version(const UsbUrb& urb) const;
  [[nodiscard]] unsigned port() const { return port_; }
  // What the kind was told by, where that is no certainty: for a mark.
  [[nodiscard]] std::string guess(const UsbUrb& urb) const;
  // "1.5, 1.7": those with bulk transfers.
  [[nodiscard]] std::string devices() const;

 private:
  struct Device {
    std::optional<UsbAdapterKind> kind;
    bool guessed = false;
    bool has_bulk = false;
    std::uint16_t version = 0;
    std::size_t packet_size = 0;
  };
  using Place = std::pair<std::uint16_t, std::uint8_t>;
  static Place place(const UsbUrb& urb) { return {urb.bus, urb.address}; }
  static std::string text(const Place& place);
  void see_descriptor(Device& device, const UsbUrb& urb, const UsbUrb::Setup& setup);
  [[nodiscard]] const Device* find(const UsbUrb& urb) const;

  std::optional<Place> bus_address_;
  std::optional<UsbAdapterKind> named_kind_;
  unsigned port_ = 1;
  std::map<Place, Device> devices_;
};

}  // namespace porttape
