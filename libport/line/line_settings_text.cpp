#include "libport/line/line_settings_text.hpp"

namespace porttape {
namespace {

std::string_view json_of(bool value) { return value ? "true" : "false"; }

// "8N1"; nothing unless all three are known.
std::string frame_text(const SeenSettings& settings) {
  if (!settings.data_bits || !settings.parity || !settings.stop_bits) return {};
  constexpr std::string_view letters = "NEOMS";
  return std::to_string(*settings.data_bits) + letters.at(static_cast<std::size_t>(*settings.parity)) +
         std::to_string(*settings.stop_bits);
}

}  // namespace

std::string_view to_string(Parity parity) { return kParityWords.at(static_cast<std::size_t>(parity)); }

std::string to_text(const SeenSettings& settings) {
  std::string text;
  const auto add = [&text](std::string_view part) {
    if (!text.empty()) text += ", ";
    text += part;
  };
  if (settings.baud) add(*settings.baud == 0 ? "hung up (B0)" : std::to_string(*settings.baud) + " baud");
  if (const std::string frame = frame_text(settings); !frame.empty()) {
    add(frame);
  } else {
    if (settings.data_bits) add(std::to_string(*settings.data_bits) + " data bits");
    if (settings.parity) add("parity " + std::string(to_string(*settings.parity)));
    if (settings.stop_bits) add(*settings.stop_bits == 1 ? "1 stop bit" : "2 stop bits");
  }
  if (settings.hw_flow.value_or(false)) add("RTS/CTS");
  if (settings.sw_flow.value_or(false)) add("XON/XOFF");
  return text.empty() ? "nothing is known of them" : text;
}

void add_settings(JsonObject& object, const SeenSettings& settings) {
  if (settings.baud) object.add("baud", *settings.baud);
  if (settings.data_bits) object.add("databits", *settings.data_bits);
  if (settings.parity) object.add("parity", to_string(*settings.parity));
  if (settings.stop_bits) object.add("stopbits", *settings.stop_bits);
  if (settings.hw_flow) object.add_raw("hwflowctrl", json_of(*settings.hw_flow));
  if (settings.sw_flow) object.add_raw("swflowctrl", json_of(*settings.sw_flow));
}

}  // namespace porttape
