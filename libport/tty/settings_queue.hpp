#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/line_settings.hpp"
#include "libport/base/workers.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/outbox.hpp"
#include "libport/loop/timer.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {

// Changes the settings of a tty that is open, in turn with the bytes that are written to it: behind those
// that were written before, as far as these get out (a second without progress is enough), and before those
// that are written after. A change of flow control alone waits for nothing: it may be what holds up the
// bytes. What may wait is done on another thread, in turn with the other jobs of `strand`.
//
// Uses the tty's descriptor and outbox, which outlive it, and keeps what is written while a change is to be
// made. Loop thread only.
class SettingsQueue {
 public:
  struct Tty {
    int fd;
    Outbox& outbox;
    Workers::Strand strand;
  };
  // One change is made, or was refused: then the line has its former settings. What was kept for it is
  // written next.
  using Made = std::function<void(const LineSettings& wanted, const Result<TakenSettings>& taken)>;

  SettingsQueue(Loop& loop, Tty tty, const LineSettings& current, Made on_made,
                std::function<void()> on_drained);

  // Of several with no byte between them the last counts.
  void change(const LineSettings& settings);
  // Without waiting for anything, for a program that waits in its calls.
  Result<TakenSettings> change_at_once(const LineSettings& settings);
  void write(ByteView data);
  // Keeps nothing; on_drained comes when more can go.
  std::size_t write_some(ByteView data);
  void discard();
  // The line is over, though this may be destroyed later: nothing is told any more.
  void stop();
  // From the outbox.
  void outbox_drained();

  // on_drained will come.
  [[nodiscard]] bool congested() const { return outbox().congested() || waited_for_; }
  [[nodiscard]] std::size_t pending() const;  // bytes that were taken and not sent
  // The last that were asked for, or the line's.
  [[nodiscard]] const LineSettings& settings() const;
  // What is to be made yet.
  [[nodiscard]] std::vector<LineSettings> left() const;

 private:
  struct Change {
    LineSettings settings;
    Bytes after;
  };

  [[nodiscard]] Outbox& outbox() const { return tty_.outbox; }
  void make_next();
  void on_timer();
  void begin(bool wait);
  void made(const LineSettings& wanted, const Result<TakenSettings>& taken);
  void tell_drained();

  Loop* loop_;
  Tty tty_;
  LineSettings current_;
  Made on_made_;
  std::function<void()> on_drained_;
  std::deque<Change> changes_;    // the first perhaps just being made
  bool making_ = false;           // on the other thread
  bool waited_for_ = false;       // by bytes, or for on_drained
  std::size_t left_at_look_ = 0;  // what was not sent when the timer was set
  Timer timer_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

// Changes a tty's settings; one that refuses them has the former again. `wait`: until what was written has
// left the device, which may take long.
Result<TakenSettings> change_settings(int fd, const LineSettings& from, const LineSettings& wanted,
                                      bool wait);

}  // namespace porttape
