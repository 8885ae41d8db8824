#pragma once

#include <optional>
#include <string>

#include "libport/base/result.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/tty/pty_bind.hpp"
#include "libport/tty/pty_link.hpp"

namespace porttape {

// What programs open a PtyPort's pty by: a link, a bind mount, both, or, without either, the slave's path
// itself, which is printed. Owns the names and takes them away with itself.
//
// Drive it: publish() once, then retarget() for each pty that takes the place of the last.
class PtyNames {
 public:
  // Paths; empty: no such name.
  PtyNames(const PortContext& context, std::string link, std::string bind)
      : context_(context), link_path_(std::move(link)), bind_path_(std::move(bind)) {}

  // On an error none is left behind.
  Result<void> publish(const std::string& slave);
  // What cannot be moved is logged.
  void retarget(const std::string& slave);

  // The one that a driver is given; the slave's path where there is none.
  [[nodiscard]] PortPlace place(const std::string& slave) const;

 private:
  void print(const std::string& slave) const;

  PortContext context_;
  std::string link_path_;
  std::string bind_path_;
  std::optional<PtyLink> link_;
  std::optional<PtyBind> bind_;
};

}  // namespace porttape
