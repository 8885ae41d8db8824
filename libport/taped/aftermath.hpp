#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "libport/base/workers.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/replay/report.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/played_tape.hpp"

namespace porttape {

// What follows a mismatch that has failed the run, for its report: the verdict stands, but the driver's line
// hangs up a moment later. Until then what else the driver writes is kept; and where it wrote a request that
// the tape has elsewhere, it gets the answer recorded there, so that it shows whether it left out what was
// due, or has the order wrong.
//
// Drive it: write() for what the driver writes, until `done` is called, once: when it has been quiet, or has
// written enough, kLimit after the mismatch at the latest. Then the report's mismatch has it all. finish()
// calls it now. Loop thread only.
class Aftermath {
 public:
  static constexpr Nanos kQuiet = std::chrono::milliseconds(50);
  static constexpr Nanos kAfterAnswer = std::chrono::milliseconds(300);  // for the first byte
  static constexpr Nanos kLimit = std::chrono::seconds(1);

  struct Tape {
    TapePaths paths;
    PlayedAs as = {};
  };
  struct Calls {
    std::function<void(ByteView answer)> deliver;
    std::function<void(RunReport)> done;
  };

  // `report` is of a run that has ended with a mismatch.
  Aftermath(const PortContext& context, Tape tape, RunReport report, Calls calls);
  ~Aftermath();
  Aftermath(const Aftermath&) = delete;
  Aftermath& operator=(const Aftermath&) = delete;

  void write(ByteView data);
  void finish();
  [[nodiscard]] bool goes_on() const { return report_.has_value(); }

 private:
  struct Search;

  void on_quiet();
  void take_got();
  void look_for_answer();
  void answer(const Bytes& bytes);
  void wait(Nanos time);

  PortContext context_;
  Tape tape_;
  std::optional<RunReport> report_;
  Calls calls_;
  Instant limit_;
  bool looked_ = false;  // for an answer
  std::shared_ptr<Search> search_;
  Workers::Strand strand_;
  Timer timer_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

}  // namespace porttape
