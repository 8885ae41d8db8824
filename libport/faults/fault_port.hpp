#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "libport/faults/fault_plan.hpp"
#include "libport/faults/fault_stream.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/filter_port.hpp"

namespace porttape {

struct FaultOptions {
  FaultPlan plan;
  std::uint64_t seed = 0;
  bool always_open = false;  // the port around which this is keeps its line, and brings it up again by itself
  bool waits = false;        // for a device that is missing
  // Told of the bytes of both streams before anything is done to them; or empty.
  std::function<void(LineDir, ByteView)> on_passing = {};
  // Told of each fault that is made, without a limit; or empty.
  std::function<void(const LineFault&)> on_made = {};
};

// A port around another whose line has the faults of a plan. They look like the line's own: what is lost is
// not told as dropped. Each fault is told to the listener and to the inner port, and the
// plan itself at each session's begin, to the inner port before prepare(). Streams count their bytes, and the
// clock runs, from the line's first session on to the end of the program.
class FaultPort final : public FilterPort {
 public:
  // Faults that are told one by one; further ones are told by their number, at a close.
  static constexpr std::uint64_t kMostTold = 10'000;

  FaultPort(const PortContext& context, std::unique_ptr<Port> inner, FaultOptions options);

  Result<void> prepare() override;
  void open() override;
  void close() override;

 private:
  struct TimedBreak {
    const Fault* fault;
    bool over = false;
  };

  void incoming(ByteView arrival) override;
  void outgoing(ByteView data) override;
  void lose_held(std::uint64_t, std::string_view) override {}
  void on_up() override;
  [[nodiscard]] std::optional<Instant> next_due() override;

  FaultStream& stream(LineDir dir);
  void pass(LineDir dir, ByteView data, const std::function<void(ByteView, Instant)>& on);
  void made(const LineFault& fault);
  void tell_sum();
  void do_timed_breaks();
  void break_line(const Fault& fault);
  void come_back();
  [[nodiscard]] bool away() const;

  PortContext context_;
  FaultOptions options_;
  LineFault plan_;
  std::optional<FaultStream> to_driver_;
  std::optional<FaultStream> to_device_;
  std::optional<Instant> zero_;
  std::vector<TimedBreak> timed_;
  Timer break_timer_;
  Timer back_timer_;
  Instant away_until_{};
  bool up_ = false;
  bool interrupted_ = false;  // by a fault
  bool open_wanted_ = false;  // once the line is back
  unsigned lines_ = 0;        // that have come up or gone down
  std::uint64_t told_ = 0;
  std::uint64_t untold_ = 0;
  std::map<std::string, std::uint64_t> sum_;  // by kind, since it was logged
};

}  // namespace porttape
