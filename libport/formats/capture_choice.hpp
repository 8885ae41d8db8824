#pragma once

#include <optional>
#include <string>

#include "libport/formats/capture_reader.hpp"

namespace porttape {

// Which of a capture's interfaces is read: the one that the user names (by its name, description or number
// from 0), else the first one that fits.
class CaptureChoice {
 public:
  using Fits = bool (*)(std::uint32_t link_type);

  CaptureChoice(std::optional<std::string> named, Fits fits) : named_(std::move(named)), fits_(fits) {}

  bool takes(const CaptureReader& reader, const CapturePacket& packet);

  [[nodiscard]] bool found() const { return section_ != 0; }
  // The name of one that fits too and was not taken; empty: there is none.
  [[nodiscard]] const std::string& left_out() const { return left_out_; }
  [[nodiscard]] const std::string& taken() const { return taken_; }
  // The link types of the others, for a message: "1, 113".
  [[nodiscard]] const std::string& other_types() const { return other_types_; }

 private:
  [[nodiscard]] bool is_named(const CaptureInterface& interface, std::size_t index) const;

  std::optional<std::string> named_;
  Fits fits_;
  std::size_t section_ = 0;
  std::size_t interface_ = 0;
  std::string taken_;
  std::string left_out_;
  std::string other_types_;
};

}  // namespace porttape
