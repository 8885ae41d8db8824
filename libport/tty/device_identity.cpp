#include "libport/tty/device_identity.hpp"

#include <array>
#include <fcntl.h>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// The first line; empty where there is none.
std::string attribute(const fs::path& folder, const char* name) {
  const UniqueFd file(::open((folder / name).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file) return {};
  std::array<char, 512> text{};
  const ssize_t size = ::read(file.get(), text.data(), text.size());
  const std::string_view all(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  return std::string(all.substr(0, all.find('\n')));
}

std::string link_name(const fs::path& link) {
  std::error_code error;
  return fs::read_symlink(link, error).filename().string();
}

// What a USB device tells of itself is put on a tape, and given to programs.
std::string one_line(std::string text) {
  for (char& each : text) {
    if (static_cast<unsigned char>(each) < 0x20U || each == 0x7f) each = ' ';
  }
  return text.substr(0, text.find_last_not_of(' ') + 1);
}

void add_usb(PortIdentity& identity, const fs::path& interface) {
  const fs::path device = interface.parent_path();
  const auto vid = whole_number<std::uint16_t>(attribute(device, "idVendor"), 16);
  const auto pid = whole_number<std::uint16_t>(attribute(device, "idProduct"), 16);
  if (!vid || !pid) return;
  identity.vid = vid;
  identity.pid = pid;
  identity.serial = one_line(attribute(device, "serial"));
  identity.manufacturer = one_line(attribute(device, "manufacturer"));
  identity.product = one_line(attribute(device, "product"));
  identity.interface = whole_number<std::uint8_t>(attribute(interface, "bInterfaceNumber"), 16);
  identity.location = device.filename().string();
}

}  // namespace

std::optional<PortIdentity> identity_of(const std::string& device, const std::string& sysfs) {
  std::error_code error;
  fs::path path = fs::canonical(device, error);
  if (error) path = device;
  const std::string name = path.filename().string();
  if (name.empty() || !fs::exists(fs::path(sysfs) / "class/tty" / name, error)) return std::nullopt;
  PortIdentity identity;
  identity.path = path.string();
  const fs::path parent = fs::canonical(fs::path(sysfs) / "class/tty" / name / "device", error);
  if (!error) {
    // A port of usb-serial is a child of the interface; others are the interface's own.
    const std::string subsystem = link_name(parent / "subsystem");
    if (subsystem == "usb-serial") add_usb(identity, parent.parent_path());
    if (subsystem == "usb") add_usb(identity, parent);
    if (identity.is_usb()) identity.driver = link_name(parent / "driver");
  }
  if (!check_identity(identity)) identity = {.path = identity.path};
  return check_identity(identity) ? std::optional(identity) : std::nullopt;
}

}  // namespace porttape
