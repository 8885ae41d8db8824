#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "libport/base/result.hpp"

namespace porttape {

// Where programs find a serial port, and what they are told of the device that it belongs to. A value; what
// is empty is not known.
struct PortIdentity {
  std::string path = {};  // /dev/ttyUSB0
  // Of the USB device; a port without them is none of USB, and has nothing of the rest.
  std::optional<std::uint16_t> vid = {};
  std::optional<std::uint16_t> pid = {};
  std::string serial = {};
  std::string manufacturer = {};
  std::string product = {};
  std::optional<std::uint8_t> interface = {};
  std::string driver = {};    // ftdi_sio, cdc_acm
  std::string location = {};  // the bus and the ports that lead to it: 1-1, 3-2.4

  [[nodiscard]] bool is_usb() const { return vid && pid; }

  friend bool operator==(const PortIdentity&, const PortIdentity&) = default;
};

// `PATH[,vid=0403,pid=6001,serial=…,manufacturer=…,product=…,interface=0,driver=…,location=1-1]`, vid and pid
// in hexadecimal digits. Errc::usage.
Result<PortIdentity> parse_identity(std::string_view text);

// Whether such a port can be. A path becomes part of commands and of the names of mounts, the rest part of
// files that programs read (/sys, udev's data), so each has a form: the path is a name below /dev, each part
// of it of letters, digits and `_.:+@-`, and begins with no '.'; texts have no control characters.
// Errc::usage, with the reason.
Result<void> check_identity(const PortIdentity& identity);

// With what every port of USB has, where it is not known: interface 0, location 1-1, a driver that fits the
// path and the vendor.
PortIdentity completed(PortIdentity identity);

// The number of a vendor or a product as it is written: `0403`. Read: of one to four hexadecimal digits, with
// or without `0x`.
std::string usb_id_text(std::uint16_t id);
std::optional<std::uint16_t> usb_id_of(std::string_view text);

// For a person: `/dev/ttyUSB0, USB 0403:6001, serial PT0001, FTDI FT232R, interface 0, ftdi_sio`.
std::string to_text(const PortIdentity& identity);

// As udev names the vendor, the model, both with the serial number (ID_SERIAL), and the link in
// /dev/serial/by-id of a port of USB: `usb-FTDI_FT232R_PT0001-if00-port0`.
std::string udev_vendor(const PortIdentity& identity);
std::string udev_model(const PortIdentity& identity);
std::string udev_serial(const PortIdentity& identity);
// The serial number (ID_SERIAL_SHORT); empty where udev takes it for none: it has a comma or is not ASCII.
std::string udev_short_serial(const PortIdentity& identity);
std::string by_id_name(const PortIdentity& identity);
// A text as udev has it in names: `FT232R USB UART` as `FT232R_USB_UART`.
std::string udev_name(std::string_view text);

// Whether the kernel has this port as a child of the interface (usb-serial), and not as the interface's own.
bool is_usb_serial(const PortIdentity& identity);

}  // namespace porttape
