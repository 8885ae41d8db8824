#pragma once

#include "tools/command_end.hpp"

namespace porttape {

// A command that was started, as the one who waits for it has it. Killed and reaped by the destructor. Loop
// thread only.
class RunningCommand {
 public:
  virtual ~RunningCommand() = default;

  [[nodiscard]] virtual bool running() const = 0;
  [[nodiscard]] virtual const CommandEnd& end() const = 0;
  virtual void kill(int signal_number) const = 0;
  // Whether it is in our process group, to which a terminal sends its signals.
  [[nodiscard]] virtual bool in_our_group() const = 0;
};

}  // namespace porttape
