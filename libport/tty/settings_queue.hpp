#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <variant>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/workers.hpp"
#include "libport/line/line_request.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/line/line_signal.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/timer.hpp"
#include "libport/tty/line_calls.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {

// Changes the settings and drives the signals of a tty that is open, in turn with the bytes that are written
// to it: behind those that were written before, and before those that are written after.
//
// | change                 | waits for what was written before                                  |
// |------------------------|--------------------------------------------------------------------|
// | settings, a break's on | until the device has sent it                                       |
// | dtr, rts, a break's off | until the kernel has taken it                                     |
// | flow control alone, a  | not at all: it may be what holds it up                             |
// | question               |                                                                    |
//
// A second without progress is enough for all of them, but a break that cannot follow its bytes is not made.
// What may wait is done on another thread, in turn with the other jobs of `strand`.
//
// Uses the tty's descriptor and outbox, which outlive it, and keeps what is written while a change is to be
// made. Loop thread only.
class SettingsQueue {
 public:
  struct Tty {
    int fd;
    Outbox& outbox;
    Workers::Strand strand;
    std::shared_ptr<LineCalls> calls;
  };
  struct Told {
    // One change is made, or was refused: then the line has its former settings. What was kept for it is
    // written next.
    std::function<void(const LineSettings& wanted, const Result<TakenSettings>& taken)> settings;
    // 0, or the error number; ETIMEDOUT: a break did not follow its bytes, which stand still.
    std::function<void(const LineSignal& signal, int error_number)> signal;
    std::function<void()> drained;
  };

  // Something else that is done to the tty in its turn.
  struct Job {
    // Behind the changes before it; and, unless `at_once`, when the kernel has the bytes before it.
    enum class Turn : std::uint8_t { at_once, behind_bytes };
    Turn turn = Turn::behind_bytes;
    // On another thread; on the loop's where there is none, unless it waits long.
    std::function<void(int fd)> work;
    // Once it is made and what was kept for it is written. Null: nobody waits for it.
    std::function<void()> done = {};
    // The line is over before it was made. Null: as above.
    std::function<void()> dropped = {};
    bool waits_long = false;
  };

  SettingsQueue(Loop& loop, Tty tty, const LineSettings& current, Told told);

  // Of several with no byte between them the last counts.
  void change(const LineSettings& settings);
  // Without waiting for anything, for a program that waits in its calls.
  Result<TakenSettings> change_at_once(const LineSettings& settings);
  void signal(const LineSignal& signal);
  void run(Job job) { add({std::move(job), {}}); }
  // The device's answer, once all before it is made; of a line that is over: EIO. Nothing: the tty has no
  // such thing, nor modem lines, and is no serial device.
  void ask(const LineRequest& request, TakeAnswer done);
  void write(ByteView data);
  // Keeps nothing; told.drained comes when more can go.
  std::size_t write_some(ByteView data);
  // Calls `done` once, from within or later: when nothing that was taken is left, here, in the kernel or in
  // the UART. Holds up nothing but the bytes that come while the UART sends its last.
  void drain(std::function<void()> done);
  void discard();
  // The line is over, though this may be destroyed later: nothing is told any more.
  void stop();
  // Those that wait for a drain wait no longer.
  void end_drains();
  // From the outbox.
  void outbox_drained();

  // told.drained will come.
  [[nodiscard]] bool congested() const { return outbox().congested() || waited_for_; }
  [[nodiscard]] std::size_t pending() const;  // bytes that were taken and not sent
  // The last that were asked for, or the line's.
  [[nodiscard]] const LineSettings& settings() const;
  // What is to be made yet.
  [[nodiscard]] std::vector<LineSettings> left() const;
  // Whether the last that was asked of it began a break.
  [[nodiscard]] bool breaks() const { return breaks_; }

 private:
  struct Step {
    std::variant<LineSettings, LineSignal, Job> what;  // a signal that begins a break; all others are jobs
    Bytes after;
  };

  [[nodiscard]] Outbox& outbox() const { return tty_.outbox; }
  void add(Step step);
  void make_next();
  void on_timer();
  void begin(bool wait);
  void do_elsewhere(std::function<void(int fd)> job, std::function<void()> done,
                    const std::function<void()>& without);
  void begin_settings(const LineSettings& wanted, bool wait);
  void begin_break(const LineSignal& signal, bool wait);
  void begin_job(const Job& job);
  void last_bytes_sent();
  void settings_made(const LineSettings& wanted, const Result<TakenSettings>& taken);
  // What comes after the step that is made; `tell` is called when its bytes are written.
  void made(const std::function<void()>& tell);
  void look_for_sent();
  void tell_drained();

  Loop* loop_;
  Tty tty_;
  LineSettings current_;
  Told told_;
  std::deque<Step> steps_;   // the first perhaps just being made
  bool making_ = false;      // on the other thread
  bool waited_for_ = false;  // by bytes, or for told.drained
  bool breaks_ = false;
  // Of the last that was begun. Written between jobs alone, which read it.
  std::shared_ptr<int> break_error_ = std::make_shared<int>(0);
  std::size_t left_at_look_ = 0;  // what was not sent when the timer was set
  Timer timer_;
  std::vector<std::function<void()>> drains_;
  std::size_t draining_ = 0;  // so many of them wait for the UART's last bytes
  Timer drain_timer_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

// Changes a tty's settings; one that refuses them has the former again. `wait`: until what was written has
// left the device, which may take long.
Result<TakenSettings> change_settings(LineCalls& calls, int fd, const LineSettings& from,
                                      const LineSettings& wanted, bool wait);

}  // namespace porttape
