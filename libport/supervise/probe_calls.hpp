#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/supervise/port_devices.hpp"
#include "libport/supervise/supervisor.hpp"

namespace porttape {

// What programs did to their ports and to the names of ports, by kind, in the order of the first of each.
struct ProbeFindings {
  enum class Effect : std::uint8_t {
    lacks,  // a plain pty refuses it
    bends,  // it takes it, and something else comes of it
    finds,  // the program looks for its port, and no pty is found so
    same    // nothing is lost
  };
  struct Row {
    std::string call;
    Effect effect = Effect::same;
    std::string_view on_pty;  // what comes of it there
    std::uint64_t count = 0;
    Nanos first{};  // since the start
  };
  struct Port {
    std::string name;
    bool pty = false;
  };
  std::vector<Row> rows;
  std::vector<Port> ports;         // that requests were made to
  std::vector<std::string> names;  // of devices, opened or asked for, the first few

  [[nodiscard]] bool any(Effect effect) const;
  // The call of a row about a device that was named.
  static std::string naming(std::string_view path);
};

std::string_view name_of(ProbeFindings::Effect effect);

// Looks at what programs do to ports, and passes all of it. A port is any tty that is neither our controlling
// terminal nor our stdin, stdout or stderr. Of 32-bit programs only requests to ports are seen.
class ProbeCalls final : public CallPart {
 public:
  // Both outlive it. The findings count their times by that clock, from now.
  ProbeCalls(ProbeFindings& findings, const Clock& clock);

  [[nodiscard]] std::vector<CallTrap> traps() const override;
  Decision decide(Supervisor& supervisor, const Call& call) override;

 private:
  void look_at_request(const Call& call);
  void look_at_path(const Call& call, std::uint64_t address);
  void look_at_settings(const Call& call, std::uint32_t request);
  void note(std::string_view call, ProbeFindings::Effect effect, std::string_view on_pty);
  void note_port(const Call& call, int fd, bool pty);

  ProbeFindings& findings_;
  const Clock* clock_;
  Instant start_;
  PortDevices ports_;
};

}  // namespace porttape
