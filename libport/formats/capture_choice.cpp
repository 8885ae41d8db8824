#include "libport/formats/capture_choice.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostTold = 100;

std::string told_name(const CaptureInterface& interface, std::size_t index) {
  if (!interface.name.empty()) return interface.name;
  return interface.description.empty() ? std::to_string(index) : interface.description;
}

}  // namespace

bool CaptureChoice::is_named(const CaptureInterface& interface, std::size_t index) const {
  return !named_ || *named_ == interface.name || *named_ == interface.description ||
         *named_ == std::to_string(index);
}

bool CaptureChoice::takes(const CaptureReader& reader, const CapturePacket& packet) {
  const CaptureInterface& interface = reader.interfaces()[packet.interface];
  if (!fits_(interface.link_type)) {
    const std::string type = std::to_string(interface.link_type);
    if (other_types_.size() < kMostTold &&
        (", " + other_types_ + ",").find(", " + type + ",") == std::string::npos)
      other_types_ += (other_types_.empty() ? "" : ", ") + type;
    return false;
  }
  const bool is_first = section_ == 0;
  // Another section counts its interfaces anew.
  if (is_named(interface, packet.interface) && (is_first || section_ != reader.section())) {
    const std::string name = told_name(interface, packet.interface);
    if (is_first || name == taken_) {
      section_ = reader.section();
      interface_ = packet.interface;
      taken_ = name;
    }
  }
  if (section_ == reader.section() && interface_ == packet.interface) return true;
  if (left_out_.empty()) left_out_ = told_name(interface, packet.interface);
  return false;
}

}  // namespace porttape
