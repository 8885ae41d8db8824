#include "libport/base/port_identity.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/utf8.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

using namespace std::string_view_literals;

constexpr std::array kIdentityKeys = {"vid"sv,     "pid"sv,       "serial"sv, "manufacturer"sv,
                                      "product"sv, "interface"sv, "driver"sv, "location"sv};
constexpr std::string_view kIdentityKeyList =
    "accepted: vid, pid, serial, manufacturer, product, interface, driver, location";
// What programs need of /dev as it is.
constexpr std::array kKeptNames = {"null"sv, "zero"sv,  "full"sv,   "random"sv,  "urandom"sv,
                                   "tty"sv,  "ptmx"sv,  "fd"sv,     "console"sv, "pts"sv,
                                   "shm"sv,  "stdin"sv, "stdout"sv, "stderr"sv};
constexpr std::size_t kMostIdentityText = 400;  // bytes: a USB device tells up to 126 characters
constexpr std::size_t kMostPath = 200;
// Beside letters and digits, in a path: what no shell, format or list takes for anything else.
constexpr std::string_view kPathCharacters = "_.:+@-";

bool has_control(std::string_view text) {
  return std::ranges::any_of(text, [](char each) {
    const auto byte = static_cast<unsigned char>(each);
    return byte < 0x20U || byte == 0x7fU;
  });
}

bool is_alphanumeric(char each) {
  return (each >= '0' && each <= '9') || (each >= 'A' && each <= 'Z') || (each >= 'a' && each <= 'z');
}

bool is_of_path(char each) {
  return is_alphanumeric(each) || kPathCharacters.find(each) != std::string_view::npos;
}

Result<void> check_path(const std::string& path) {
  const auto refuse = [&](const std::string& why) {
    return usage_error("port " + in_quotes(path) + " " + why +
                       "; accepted: a name below /dev, such as /dev/ttyUSB0");
  };
  constexpr std::string_view kDev = "/dev/";
  if (has_control(path)) return refuse("has control characters");
  if (!path.starts_with(kDev) || path.size() == kDev.size()) return refuse("is not below /dev");
  if (path.size() > kMostPath) return refuse("is too long");
  const std::string_view name = std::string_view(path).substr(kDev.size());
  for (std::string_view rest = name;;) {
    const std::size_t slash = rest.find('/');
    const std::string_view part = rest.substr(0, slash);
    if (part.empty()) return refuse("has an empty part");
    if (part.front() == '.') return refuse("has a part that begins with '.'");
    if (!std::ranges::all_of(part, is_of_path))
      return refuse("has other characters than letters, digits and " + std::string(kPathCharacters));
    if (slash == std::string_view::npos) break;
    rest.remove_prefix(slash + 1);
  }
  if (std::ranges::find(kKeptNames, name.substr(0, name.find('/'))) != kKeptNames.end())
    return refuse("is a name that every program needs as it is");
  return {};
}

Result<void> check_identity_text(std::string_view key, const std::string& text) {
  if (text.size() > kMostIdentityText) {
    return usage_error("key " + in_quotes(key) + ": a text of " + std::to_string(text.size()) +
                       " bytes; accepted: up to " + std::to_string(kMostIdentityText));
  }
  if (has_control(text)) {
    return usage_error("key " + in_quotes(key) + ": " + in_quotes(text) +
                       " has control characters; accepted: a text of one line");
  }
  return {};
}

// One that becomes the name of a folder.
Result<void> check_driver(const std::string& driver) {
  const bool fits = std::ranges::all_of(
      driver, [](char each) { return is_alphanumeric(each) || each == '_' || each == '-'; });
  if (fits) return {};
  return usage_error("key 'driver': " + in_quotes(driver) +
                     " is not a driver's name; accepted: one such as ftdi_sio or cdc_acm");
}

Result<void> check_location(const std::string& location) {
  const std::size_t dash = location.find('-');
  const auto numbers = [](std::string_view text) {
    return !text.empty() && text.front() != '.' && text.back() != '.' && text.find("..") == text.npos &&
           text.find_first_not_of("0123456789.") == text.npos;
  };
  const std::string_view bus = std::string_view(location).substr(0, dash);
  const bool fits = location.size() <= 32 && dash != std::string::npos &&
                    bus.find('.') == std::string_view::npos && numbers(bus) &&
                    numbers(std::string_view(location).substr(dash + 1));
  if (fits) return {};
  return usage_error("key 'location': " + in_quotes(location) +
                     " is no place on a USB bus; accepted: BUS-PORT, such as 1-1 or 3-2.4");
}

std::string hex_text(unsigned number, int digits) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%0*x", digits, number);
  return text.data();
}

Result<void> take_id(std::optional<std::uint16_t>& id, std::string_view key, std::string_view value) {
  const std::string_view digits =
      value.starts_with("0x") || value.starts_with("0X") ? value.substr(2) : value;
  id = digits.size() <= 4 ? whole_number<std::uint16_t>(digits, 16) : std::nullopt;
  if (id) return {};
  return usage_error("key " + in_quotes(key) + ": " + in_quotes(value) +
                     " is not four hexadecimal digits; accepted: 0000 to ffff");
}

Result<void> take_identity_key(PortIdentity& identity, std::string_view key, std::string_view value) {
  if (value.empty())
    return usage_error("key " + in_quotes(key) + " has no value; accepted: " + std::string(key) + "=VALUE");
  if (key == "vid") return take_id(identity.vid, key, value);
  if (key == "pid") return take_id(identity.pid, key, value);
  if (key == "interface") {
    identity.interface = whole_number<std::uint8_t>(value);
    if (identity.interface) return {};
    return usage_error("key 'interface': " + in_quotes(value) + " is not a number; accepted: 0 to 255");
  }
  const std::array<std::pair<std::string_view, std::string*>, 5> texts{
      {{"serial", &identity.serial},
       {"manufacturer", &identity.manufacturer},
       {"product", &identity.product},
       {"driver", &identity.driver},
       {"location", &identity.location}}};
  for (const auto& [name, text] : texts) {
    if (name == key) *text = value;
  }
  return {};
}

}  // namespace

std::string usb_id_text(std::uint16_t id) { return hex_text(id, 4); }

std::optional<std::uint16_t> usb_id_of(std::string_view text) {
  if (text.starts_with("0x") || text.starts_with("0X")) text.remove_prefix(2);
  return text.size() <= 4 ? whole_number<std::uint16_t>(text, 16) : std::nullopt;
}

Result<void> check_identity(const PortIdentity& identity) {
  if (Result<void> path = check_path(identity.path); !path) return path;
  for (const auto& [key, text] :
       {std::pair<std::string_view, const std::string*>("serial", &identity.serial),
        std::pair<std::string_view, const std::string*>("manufacturer", &identity.manufacturer),
        std::pair<std::string_view, const std::string*>("product", &identity.product),
        std::pair<std::string_view, const std::string*>("driver", &identity.driver)}) {
    if (Result<void> checked = check_identity_text(key, *text); !checked) return checked;
  }
  if (Result<void> driver = check_driver(identity.driver); !driver) return driver;
  if (!identity.location.empty()) {
    if (Result<void> location = check_location(identity.location); !location) return location;
  }
  PortIdentity path_alone;
  path_alone.path = identity.path;
  if (identity.is_usb() || identity == path_alone) return {};
  return usage_error("port " + in_quotes(identity.path) + " has " +
                     (identity.vid   ? "a vid and no pid"
                      : identity.pid ? "a pid and no vid"
                                     : "something of a USB device, and no vid and pid") +
                     "; accepted: vid=0403,pid=6001 and so on, or the path alone");
}

Result<PortIdentity> parse_identity(std::string_view text) {
  PortIdentity identity;
  std::size_t comma = text.find(',');
  identity.path = text.substr(0, comma);
  std::vector<std::string_view> seen;
  while (comma != std::string_view::npos) {
    text.remove_prefix(comma + 1);
    comma = text.find(',');
    const std::string_view one = text.substr(0, comma);
    const std::string_view key = one.substr(0, one.find('='));
    if (std::ranges::find(kIdentityKeys, key) == kIdentityKeys.end()) {
      return usage_error("unknown key " + in_quotes(key) + "; " + std::string(kIdentityKeyList) +
                         did_you_mean(key, kIdentityKeys));
    }
    if (std::ranges::find(seen, key) != seen.end())
      return usage_error("key " + in_quotes(key) + " is given twice; leave out one of them");
    seen.push_back(key);
    const std::string_view value = key.size() < one.size() ? one.substr(key.size() + 1) : "";
    if (Result<void> taken = take_identity_key(identity, key, value); !taken) return taken.error();
  }
  if (Result<void> checked = check_identity(identity); !checked) return checked.error();
  return identity;
}

bool is_usb_serial(const PortIdentity& identity) {
  return identity.driver.empty() ? !identity.path.starts_with("/dev/ttyACM") : identity.driver != "cdc_acm";
}

PortIdentity completed(PortIdentity identity) {
  if (!identity.is_usb()) return identity;
  if (!identity.interface) identity.interface = std::uint8_t{0};
  if (identity.location.empty()) identity.location = "1-1";
  if (!identity.driver.empty()) return identity;
  constexpr std::array<std::pair<unsigned, std::string_view>, 4> kDrivers = {
      {{0x0403, "ftdi_sio"}, {0x10c4, "cp210x"}, {0x067b, "pl2303"}, {0x1a86, "ch341-uart"}}};
  const auto known = std::ranges::find(kDrivers, static_cast<unsigned>(*identity.vid),
                                       &decltype(kDrivers)::value_type::first);
  identity.driver = !is_usb_serial(identity)  ? "cdc_acm"
                    : known == kDrivers.end() ? "usbserial_generic"
                                              : known->second;
  return identity;
}

std::string to_text(const PortIdentity& identity) {
  std::string text = identity.path;
  if (!identity.is_usb()) return text;
  text += ", USB " + hex_text(*identity.vid, 4) + ":" + hex_text(*identity.pid, 4);
  if (!identity.serial.empty()) text += ", serial " + identity.serial;
  std::string who = identity.manufacturer;
  if (!who.empty() && !identity.product.empty()) who += ' ';
  who += identity.product;
  if (!who.empty()) text += ", " + who;
  if (identity.interface) text += ", interface " + std::to_string(*identity.interface);
  if (!identity.driver.empty()) text += ", " + identity.driver;
  return text;
}

std::string udev_name(std::string_view text) {
  constexpr std::string_view kSpace = " \t\n\v\f\r";
  constexpr std::string_view kKept = "#+-.:=@_";
  std::string name;
  while (!text.empty() && kSpace.find(text.front()) != kSpace.npos) text.remove_prefix(1);
  while (!text.empty() && kSpace.find(text.back()) != kSpace.npos) text.remove_suffix(1);
  while (!text.empty()) {
    const std::size_t length = std::max<std::size_t>(utf8_length(text), 1);
    const char first = text.front();
    if (kSpace.find(first) != kSpace.npos) {
      name += '_';
      text.remove_prefix(std::min(text.find_first_not_of(kSpace), text.size()));
      continue;
    }
    const bool kept = length > 1 || is_alphanumeric(first) || kKept.find(first) != kKept.npos;
    name += kept ? text.substr(0, length) : "_";
    text.remove_prefix(length);
  }
  return name;
}

std::string udev_vendor(const PortIdentity& identity) {
  if (std::string name = udev_name(identity.manufacturer); !name.empty()) return name;
  return hex_text(identity.vid.value_or(0), 4);
}

std::string udev_model(const PortIdentity& identity) {
  if (std::string name = udev_name(identity.product); !name.empty()) return name;
  return hex_text(identity.pid.value_or(0), 4);
}

std::string udev_short_serial(const PortIdentity& identity) {
  const bool taken = std::ranges::all_of(
      identity.serial, [](char each) { return static_cast<signed char>(each) >= ' ' && each != ','; });
  return taken ? udev_name(identity.serial) : std::string();
}

std::string udev_serial(const PortIdentity& identity) {
  std::string text = udev_vendor(identity) + "_" + udev_model(identity);
  if (const std::string serial = udev_short_serial(identity); !serial.empty()) text += "_" + serial;
  return text;
}

std::string by_id_name(const PortIdentity& identity) {
  if (!identity.is_usb()) return {};
  return "usb-" + udev_serial(identity) + "-if" + hex_text(identity.interface.value_or(0), 2) +
         (is_usb_serial(identity) ? "-port0" : "");
}

}  // namespace porttape
