#pragma once

#include <asm/termbits.h>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/end_wait.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/port/supervised_line.hpp"
#include "libport/supervise/line_model.hpp"
#include "libport/supervise/supervisor.hpp"
#include "libport/supervise/uart_model.hpp"

namespace porttape {

struct EventRequest;

// Gives a driver on a pty what only a serial line has: modem lines, breaks, counters, parity and data bits
// that are read back as they were set, drains that last, and its settings and flushes an exact place among
// what it writes. Does so for every descriptor of that pty, whatever way a program got it.
//
// What the kernel's pty does right is left to it, and all of it once the line's port has gone.
class TtyCalls final : public CallPart, private LineSupervisor {
 public:
  using Tell = std::function<void(const std::string& what)>;

  // `tell` hears once of a program whose descriptors must not be looked at: its port stays a plain pty.
  TtyCalls(SupervisedLine& line, const LineDefaults& defaults, Tell tell);
  ~TtyCalls() override;
  TtyCalls(const TtyCalls&) = delete;
  TtyCalls& operator=(const TtyCalls&) = delete;

  [[nodiscard]] std::vector<CallTrap> traps() const override;
  Decision decide(Supervisor& supervisor, const Call& call) override;

 private:
  // So long bytes hold up what comes behind them while the device takes none of them. At 9600 baud 4 KiB,
  // what a pty gives at once, take 4.3 s.
  static constexpr Nanos kCatchUpLimit = std::chrono::seconds(5);
  static constexpr Nanos kCatchUpLook = std::chrono::milliseconds(1);
  static constexpr Nanos kBreak = std::chrono::milliseconds(250);  // where the driver does not say how long

  struct InputWait {
    std::shared_ptr<KeptCall> call;
    int mask = 0;
    LineModel::Counters since;
  };

  void line_opened() override;
  void line_closed() override;
  void line_shows(const LineSettings& settings) override;
  void line_signalled(const LineSignal& signal) override;
  void line_gone() override;

  using Then = std::function<Outcome(const Call& call, SettingsOrder order)>;
  using Step = std::function<void(SettingsOrder order)>;
  using KeptStep = std::function<void(const std::shared_ptr<KeptCall>& waiting, SettingsOrder order)>;
  // For the bytes before a call; `passed_on`: what the line had passed on when it was looked at last.
  struct Patience {
    EndWait wait;
    std::uint64_t passed_on = 0;
  };
  void catch_up(const std::shared_ptr<KeptCall>& kept, Patience patience, const Step& step);
  Decision behind_writes(Supervisor& supervisor, const Call& call, const Then& then);
  void when_sent(const std::shared_ptr<KeptCall>& kept, const KeptStep& step);
  Decision behind_sent(const std::shared_ptr<KeptCall>& kept, const Then& then);

  Decision decide_settings(Supervisor& supervisor, const Call& call, std::uint32_t request);
  Decision decide_signals(Supervisor& supervisor, const Call& call, std::uint32_t request);
  Decision decide_break(Supervisor& supervisor, const Call& call, std::uint32_t request);
  Outcome give_settings(const Call& call, std::uint32_t request) const;
  Outcome make_settings(const Call& call, std::uint32_t request, SettingsOrder order);
  Outcome make(const EventRequest& request, const Call& call);
  Outcome give_lines(const Call& call) const;
  Outcome drive_lines(const Call& call, std::uint32_t request);
  void drive(LineSignal::Name name, bool on);
  void signalled(const LineSignal& signal);
  Decision wait_for_input(Supervisor& supervisor, const Call& call);
  void tell_inputs();
  void look_at_inputs();
  using Answered = std::function<Outcome(const Call& call, const std::optional<LineAnswer>& answer)>;
  Decision ask(Supervisor& supervisor, const Call& call, const LineRequest& request, const Answered& then);
  using Told = std::function<void(KeptCall& waiting, const std::optional<LineAnswer>& answer)>;
  void ask_for(const std::shared_ptr<KeptCall>& kept, const LineRequest& request, const Told& then);
  void set_serial(const std::shared_ptr<KeptCall>& kept, const serial_struct& wanted);
  using Begun = std::function<void(KeptCall& waiting, int error)>;
  Decision begin_break(Supervisor& supervisor, const Call& call, const Begun& then);
  Decision send_break(Supervisor& supervisor, const Call& call, Nanos length);
  Outcome give_counters(const Call& call) const;
  Decision give_serial(Supervisor& supervisor, const Call& call);
  Decision make_serial(Supervisor& supervisor, const Call& call);
  Decision give_rs485(Supervisor& supervisor, const Call& call);
  Decision make_rs485(Supervisor& supervisor, const Call& call);
  [[nodiscard]] LineSettings settings_now() const;

  SupervisedLine* line_;  // null: it has gone
  LineModel model_;
  tcflag_t hidden_ = CS8 | CLOCAL;  // of c_cflag what a pty of ours does not keep
  bool hung_up_ = false;            // B0
  bool open_ = false;
  bool as_opened_ = true;     // nobody has set the line since
  bool tells_lines_ = false;  // the defaults are the user's: they belong on the tape
  Tell tell_;                 // null: told, or not wanted
  UartModel uart_;
  std::optional<int> told_inputs_;  // in this session
  std::vector<InputWait> input_waits_;
};

}  // namespace porttape
