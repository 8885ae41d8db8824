#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/line/waiting_requests.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/port.hpp"

namespace porttape {

// Notes what a port tells.
class PortLog final : public PortListener {
 public:
  void on_up() override { events += "up "; }
  void on_data(ByteView bytes) override {
    data += as_text(bytes);
    ++calls;
    if (on_bytes) on_bytes();
  }
  void on_arrivals(ByteView bytes, std::span<const std::size_t> ends) override {
    arrivals += ends.size();
    on_data(bytes);
  }
  void on_drained() override { events += "drained "; }
  void on_down(const LineDown& down) override {
    events += down.reason == LineDown::Reason::closed   ? "closed "
              : down.reason == LineDown::Reason::failed ? "failed "
              : down.reason == LineDown::Reason::lost   ? "lost "
                                                        : "hung_up ";
    error = down.error;
    after_reading = down.after_reading;
  }
  Answers on_ended() override {
    events += "ended ";
    return answers;
  }
  [[nodiscard]] bool half_closes() const override { return peer_half_closes; }
  bool wants_rest() override { return wanted; }
  [[nodiscard]] std::optional<std::size_t> unread() const override { return peer_unread; }
  void on_interrupted(const LineDown& down) override {
    events += "interrupted ";
    error = down.error;
  }
  void on_resumed() override { events += "resumed "; }
  void told(const LineEvent& event) override {
    std::visit([this](const auto& each) { note(each); }, event);
  }
  void on_finished(int exit_status) override { events += "finished" + std::to_string(exit_status) + " "; }

  void on_complete(int exit_status) override { status = exit_status; }

  // What a peer asks a port for, with who takes the answer.
  void drain(Port& port, std::function<void()> done) { port.tell(line::Drain{drains.keep(std::move(done))}); }
  void ask(Port& port, const LineRequest& request, TakeAnswer done) {
    port.tell(line::Ask{questions.keep(std::move(done)), request});
  }

  std::string events;
  std::optional<int> status;  // once complete
  std::string data;
  Error error;
  bool after_reading = false;
  std::string why;        // of the last line::Dropped
  SeenSettings settings;  // the last that were told
  SettingsOrder settings_order = SettingsOrder::exact;
  std::size_t settings_after = 0;          // bytes
  std::vector<std::size_t> signals_after;  // bytes, each of a signal
  std::uint64_t dropped = 0;
  std::optional<std::uint64_t> left_unread;      // by the last peer
  std::vector<std::uint64_t> refused;            // what each that was turned away had written
  int calls = 0;                                 // that brought bytes,
  std::size_t arrivals = 0;                      // and arrivals in those of on_arrivals
  Answers answers = Answers::until_it_is_quiet;  // what on_ended gives
  std::function<void()> on_bytes;                // what it does when some have come
  bool peer_half_closes = false;
  bool wanted = false;                       // what wants_rest gives
  std::optional<std::size_t> peer_unread{};  // what unread gives
  Port* answers_to = nullptr;                // the port whose peer is answered at once
  WaitingRequests<std::function<void()>> drains;
  WaitingRequests<TakeAnswer> questions;

 private:
  void note(const line::Settings& made) {
    events += "settings ";
    settings = made.seen;
    settings_order = made.order;
    settings_after = data.size();
  }
  void note(const LineSignal& signal) {
    events += std::string(name_of(signal.name)) + (signal.on ? "+ " : "- ");
    signals_after.push_back(data.size());
  }
  void note(const line::Flush& flush) {
    events += flush.queue == FlushQueue::in    ? "flush_in "
              : flush.queue == FlushQueue::out ? "flush_out "
                                               : "flush_both ";
  }
  void note(const line::Drain& drain) {
    events += "drain ";
    if (answers_to != nullptr) answers_to->tell(line::Sent{drain.number});
  }
  void note(const line::Sent& sent) {
    if (const auto done = drains.take(sent.number)) (*done)();
  }
  void note(const line::Ask& question) {
    if (answers_to != nullptr) answers_to->tell(line::Answer{question.number, std::nullopt});
  }
  void note(const line::Answer& answer) {
    if (const auto done = questions.take(answer.number)) (*done)(answer.answer);
  }
  void note(const line::Dropped& lost) {
    dropped += lost.bytes;
    why = lost.why;
  }
  void note(const line::LeftUnread& left) { left_unread = left.bytes; }
  void note(const line::Refused& other) { refused.push_back(other.bytes); }
  void note(const LineFault&) {}
  void note(const line::Mark& mark) { events += "mark:" + mark.text + " "; }
  void note(const line::WatchSignals&) {}
};

// A peer that reads whatever comes.
struct Reader {
  Reader(Loop& loop, int fd)
      : watch(loop, fd, [this, fd] {
          char buffer[4096];
          const ssize_t size = ::read(fd, buffer, sizeof buffer);
          if (size > 0) {
            got.append(buffer, static_cast<std::size_t>(size));
          } else {
            watch.watch_readable(false);
          }
        }) {
    watch.watch_readable(true);
  }
  std::string got;
  FdWatch watch;
};

// Runs the loop until `done`, and fails the test when that takes absurdly long.
inline void run_until(Loop& loop, const std::function<bool()>& done) {
  bool late = false;
  Timer limit(
      loop, [&late] { late = true; }, Timer::By::machine);
  limit.set_after(std::chrono::seconds(60));
  while (!done() && !late) {
    if (!loop.run_one()) loop.restart();  // it had run out of work
  }
  EXPECT_FALSE(late) << "what the test waits for did not come";
}

}  // namespace porttape
