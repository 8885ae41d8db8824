#pragma once

#include <optional>
#include <string>

#include "libport/base/own_name.hpp"
#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "tools/control_place.hpp"

namespace porttape {

// The socket of this process in a control folder. The destructor removes it, unless its name means another
// file by then.
class ControlListener {
 public:
  // Makes the folder if need be, and the socket, which only its owner can use (0600); a stale one of that
  // name is removed. Errc::io, Errc::usage.
  static Result<ControlListener> create(const ControlFolder& folder);
  ControlListener(ControlListener&&) noexcept = default;
  ControlListener& operator=(ControlListener&&) = delete;
  ~ControlListener();

  [[nodiscard]] int fd() const { return fd_.get(); }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  ControlListener(UniqueFd fd, std::string path);

  UniqueFd fd_;
  std::string path_;
  std::optional<FileIdentity> socket_;  // unset if it cannot be examined
};

}  // namespace porttape
