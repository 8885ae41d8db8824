#include "libport/catalog/port_guess.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/catalog/port_types.hpp"
#include "libport/port/spelling.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

bool all_digits(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
}

// "COM3", "com12:".
bool is_windows_name(std::string_view main) {
  if (main.ends_with(':')) main.remove_suffix(1);
  return main.size() > 3 && (main.starts_with("COM") || main.starts_with("com")) &&
         all_digits(main.substr(3));
}

// Below /dev/, without it.
bool is_device_name(std::string_view main) {
  if (main.starts_with("tty") && main.size() > 3 && main.find(':') == std::string_view::npos) return true;
  return main.starts_with("serial/by-") || (main.starts_with("pts/") && all_digits(main.substr(4)));
}

// "host:2000", "[::1]:2000", "2000".
bool is_address(std::string_view main) {
  if (all_digits(main)) return true;
  const std::size_t colon = main.rfind(':');
  return colon != std::string_view::npos && colon > 0 && all_digits(main.substr(colon + 1)) &&
         main.find('/') == std::string_view::npos;
}

std::string address(std::string_view main, LineEnd end) {
  if (end == LineEnd::driver) return fmt::format("tcp-listen:{}", main);
  return fmt::format("tcp:{}{}", all_digits(main) ? "127.0.0.1:" : "", main);
}

std::string_view type_at(const fs::path& path, LineEnd end) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (fs::is_socket(status)) return end == LineEnd::driver ? "unix-listen" : "unix";
  return fs::is_character_file(status) || end == LineEnd::device ? "serial" : "pty";
}

// "tcp://host:2000", as URLs and other tools have it.
std::string without_slashes(std::string_view text, LineEnd end) {
  const std::size_t slashes = text.find("://");
  if (slashes == std::string_view::npos || slashes == 0) return {};
  const std::string_view rest = text.substr(slashes + 3);
  const std::string_view scheme = text.substr(0, slashes);
  if (scheme == "tcp" || scheme == "socket") return address(rest, end);
  return names_type(port_types(), fmt::format("{}:", scheme)) ? fmt::format("{}:{}", scheme, rest) : "";
}

// The type whose first option a text of options begins with: "device=/dev/ttyUSB0,baud=9600".
std::string with_type(std::string_view text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string_view::npos) return {};
  for (const PortType& type : port_types().all()) {
    if (type.form.main == text.substr(0, equals)) return fmt::format("type={},{}", type.name, text);
  }
  return {};
}

// A port whose type is not there.
std::string without_type(std::string_view text, LineEnd end) {
  if (std::string whole = with_type(text); !whole.empty()) return whole;
  const std::size_t comma = std::min(text.find(','), text.size());
  const std::string_view main = text.substr(0, comma);
  const std::string_view options = text.substr(comma);
  if (is_device_name(main)) return fmt::format("/dev/{}{}", main, options);
  if (main.starts_with("dev/")) return fmt::format("/{}{}", main, options);
  const std::vector<std::string> spellings = port_types().spellings();
  const std::vector<std::string_view> types(spellings.begin(), spellings.end());
  if (nearest(main.substr(0, main.find(':')), types)) return {};
  if (is_address(main)) return address(main, end) + std::string(options);
  if (main.find('/') != std::string_view::npos)
    return fmt::format("{}:{}{}", type_at(main, end), main, options);
  return {};
}

bool is_tape(std::string_view text) {
  return !text.empty() && !names_type(port_types(), text) && find_tape(text);
}

}  // namespace

std::string meant_port(std::string_view text, LineEnd end) {
  if (std::string url = without_slashes(text, end); !url.empty()) return url;
  if (names_type(port_types(), text)) return std::string(text);
  return is_tape(text) ? std::string() : without_type(text, end);
}

bool looks_like_port(std::string_view text) {
  return is_windows_name(text) || !meant_port(text, LineEnd::device).empty();
}

std::optional<std::string> guess_port(std::string_view text, LineEnd end) {
  if (is_windows_name(text.substr(0, text.find(','))))
    return "is a name that Windows has; here it is a path like /dev/ttyUSB0: ls -l /dev/serial/by-id";
  if (is_tape(text)) {
    return fmt::format("is a tape, not a port; to play it: porttaped replay --tape {} --driver pty:/tmp/port",
                       shell_word(text));
  }
  const std::string meant = meant_port(text, end);
  if (meant.empty() || meant == text) return std::nullopt;
  return fmt::format("is not a port; did you mean {}?", in_quotes(meant));
}

std::optional<std::string> with_speed(std::string_view text) {
  const std::size_t end = text.find_last_of(":@ ,");
  if (end == std::string_view::npos || !all_digits(text.substr(end + 1))) return std::nullopt;
  std::string_view device = text.substr(0, end);
  if (constexpr std::string_view type = "serial:"; device.starts_with(type))
    device.remove_prefix(type.size());
  // Other names may well have a colon and a number at the end.
  const bool is_tty =
      device.starts_with("/dev/tty") && device.find_first_of(":@ ,") == std::string_view::npos;
  if (!is_tty) return std::nullopt;
  return fmt::format("{},baud={}", device, text.substr(end + 1));
}

}  // namespace porttape
