#include "libport/supervise/device_tree.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <string_view>
#include <sys/sysmacros.h>
#include <utility>

namespace porttape {
namespace {

// Hidden from who lists the class, and not below /sys/devices/virtual, which libserialport passes over.
constexpr std::string_view kTreeRoot = "/sys/class/tty/.porttape";

// Below /dev; as the kernel names the port, which has no '/'.
std::string name_in_dev(const PortIdentity& identity) { return identity.path.substr(5); }
std::string kernel_name(const PortIdentity& identity) {
  std::string name = name_in_dev(identity);
  std::ranges::replace(name, '/', '!');
  return name;
}

// As udev has texts that are not cut to a name: `FT232R\x20USB`.
std::string udev_encoded(std::string_view text) {
  std::string encoded;
  for (const char each : text) {
    const auto byte = static_cast<unsigned char>(each);
    const bool kept = byte >= 0x80U || udev_name({&each, 1}) == std::string_view(&each, 1);
    encoded += kept ? std::string(1, each) : fmt::format("\\x{:02x}", byte);
  }
  return encoded;
}

class TreeMaker {
 public:
  TreeMaker(const PortIdentity& identity, dev_t device) : port_(completed(identity)), device_(device) {}

  DeviceTree made() {
    const std::string parent = port_.is_usb() ? add_usb() : add_plain();
    add_tty(parent);
    add_names();
    add_udev();
    return std::move(tree_);
  }

 private:
  void file(const std::string& path, const std::string& text) { tree_.files.emplace_back(path, text + '\n'); }
  void link(const std::string& path, const std::string& target) { tree_.links.emplace_back(path, target); }
  void file_if(const std::string& path, const std::string& text) {
    if (!text.empty()) file(path, text);
  }
  [[nodiscard]] std::string product_key() const {
    return fmt::format("PRODUCT={:x}/{:x}/100", *port_.vid, *port_.pid);
  }

  // Of the device that the port belongs to; gives the tty's parent.
  std::string add_usb() {
    const std::string bus = port_.location.substr(0, port_.location.find('-'));
    const std::string device = fmt::format("{}/usb{}/{}", kTreeRoot, bus, port_.location);
    const unsigned number = *port_.interface;
    file(device + "/idVendor", fmt::format("{:04x}", *port_.vid));
    file(device + "/idProduct", fmt::format("{:04x}", *port_.pid));
    file_if(device + "/serial", port_.serial);
    file_if(device + "/manufacturer", port_.manufacturer);
    file_if(device + "/product", port_.product);
    // A modem's second one is of its data.
    file(device + "/bNumInterfaces", fmt::format("{:2}", number + (is_usb_serial(port_) ? 1 : 2)));
    file(device + "/bDeviceClass", "00");
    file(device + "/bcdDevice", "0100");
    file(device + "/busnum", bus);
    file(device + "/devnum", "2");
    file(device + "/devpath", port_.location.substr(bus.size() + 1));
    file(device + "/speed", "12");
    file(device + "/version", " 2.00");
    file(device + "/uevent",
         fmt::format("DEVTYPE=usb_device\nDRIVER=usb\n{}\nTYPE=0/0/0\nBUSNUM={:0>3}\nDEVNUM=002",
                     product_key(), bus));
    link(device + "/subsystem", "/sys/bus/usb");
    link(device + "/driver", "/sys/bus/usb/drivers/usb");
    return add_interface(device, number);
  }

  std::string add_interface(const std::string& device, unsigned number) {
    const bool child = is_usb_serial(port_);
    const std::string interface = fmt::format("{}/{}:1.{}", device, port_.location, number);
    const std::string_view kind = child ? "ff" : "02";
    file(interface + "/bInterfaceNumber", fmt::format("{:02x}", number));
    file(interface + "/bInterfaceClass", std::string(kind));
    file(interface + "/uevent",
         fmt::format("DEVTYPE=usb_interface\nDRIVER={}\n{}\nTYPE=0/0/0\nINTERFACE={}/0/0", port_.driver,
                     product_key(), child ? 255 : 2));
    link(interface + "/subsystem", "/sys/bus/usb");
    link(interface + "/driver", "/sys/bus/usb/drivers/" + port_.driver);
    if (!child) return interface;
    std::string port = interface + '/' + kernel_name(port_);
    file(port + "/port_number", "0");
    if (port_.driver == "ftdi_sio") file(port + "/latency_timer", "16");
    file(port + "/uevent", "DRIVER=" + port_.driver);
    link(port + "/subsystem", "/sys/bus/usb-serial");
    link(port + "/driver", "/sys/bus/usb-serial/drivers/" + port_.driver);
    // Where programs look for the latency timer.
    link("/sys/bus/usb-serial/devices/" + kernel_name(port_),
         "../../../" + port.substr(std::string_view("/sys/").size()));
    return port;
  }

  std::string add_plain() {
    const std::string parent = fmt::format("{}/pnp0/00:{}", kTreeRoot, kernel_name(port_));
    file(parent + "/id", "PNP0501");
    file(parent + "/uevent", "DRIVER=serial");
    link(parent + "/subsystem", "/sys/bus/pnp");
    link(parent + "/driver", "/sys/bus/pnp/drivers/serial");
    return parent;
  }

  void add_tty(const std::string& parent) {
    const std::string name = kernel_name(port_);
    const std::string number = fmt::format("{}:{}", ::major(device_), ::minor(device_));
    tree_.folder = parent + "/tty/" + name;
    file(tree_.folder + "/dev", number);
    file(tree_.folder + "/uevent", fmt::format("MAJOR={}\nMINOR={}\nDEVNAME={}", ::major(device_),
                                               ::minor(device_), name_in_dev(port_)));
    link(tree_.folder + "/device", "../../../" + parent.substr(parent.rfind('/') + 1));
    link(tree_.folder + "/subsystem", "/sys/class/tty");
    // Relative, as all that the kernel makes.
    link("/sys/class/tty/" + name, tree_.folder.substr(std::string_view("/sys/class/tty/").size()));
    link("/sys/dev/char/" + number, "../../" + tree_.folder.substr(std::string_view("/sys/").size()));
  }

  // Of links that lead to it, those of udev's rules.
  void add_names() {
    if (!port_.is_usb()) return;
    id_path_ = fmt::format("platform-porttape-usb-0:{}:1.{}",
                           port_.location.substr(port_.location.find('-') + 1), *port_.interface);
    const std::string target = "../../" + name_in_dev(port_);
    for (const std::string& name :
         {"by-id/" + by_id_name(port_), "by-path/" + id_path_ + (is_usb_serial(port_) ? "-port0" : "")}) {
      if (std::string link = "/dev/serial/" + name; link != port_.path)
        tree_.names.emplace_back(std::move(link), target);
    }
  }

  void add_udev() {
    std::string& data = tree_.udev_data;
    for (const auto& name : tree_.names) data += "S:" + name.first.substr(5) + '\n';
    data += "I:1\n";
    const auto tell = [&](std::string_view key, const std::string& value) {
      if (!value.empty()) data += fmt::format("E:{}={}\n", key, value);
    };
    if (port_.is_usb()) {
      tell("ID_BUS", "usb");
      const std::string vendor = usb_id_text(*port_.vid);
      const std::string model = usb_id_text(*port_.pid);
      for (const std::string& prefix : {std::string("ID_"), std::string("ID_USB_")}) {
        tell(prefix + "VENDOR", udev_vendor(port_));
        tell(prefix + "VENDOR_ENC", udev_encoded(port_.manufacturer.empty() ? vendor : port_.manufacturer));
        tell(prefix + "VENDOR_ID", vendor);
        tell(prefix + "MODEL", udev_model(port_));
        tell(prefix + "MODEL_ENC", udev_encoded(port_.product.empty() ? model : port_.product));
        tell(prefix + "MODEL_ID", model);
        tell(prefix + "REVISION", "0100");
        tell(prefix + "SERIAL", udev_serial(port_));
        tell(prefix + "SERIAL_SHORT", udev_short_serial(port_));
        tell(prefix + "TYPE", "generic");
      }
      tell("ID_USB_INTERFACE_NUM", fmt::format("{:02x}", *port_.interface));
      tell("ID_USB_INTERFACES", is_usb_serial(port_) ? ":ffffff:" : ":020201:0a0000:");
      tell("ID_USB_DRIVER", port_.driver);
      tell("ID_PATH", id_path_);
    }
    data += "G:systemd\nQ:systemd\nV:1\n";
  }

  PortIdentity port_;
  dev_t device_;
  std::string id_path_;
  DeviceTree tree_;
};

}  // namespace

DeviceTree device_tree(const PortIdentity& identity, dev_t device) {
  return TreeMaker(identity, device).made();
}

}  // namespace porttape
