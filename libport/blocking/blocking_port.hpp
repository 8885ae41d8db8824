#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <spdlog/fwd.h>

#include "libport/base/result.hpp"
#include "libport/blocking/input_buffer.hpp"
#include "libport/blocking/loop_wait.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {

// How a call that may wait ended.
struct Transfer {
  enum class End : std::uint8_t {
    done,       // `bytes` were moved
    timed_out,  // the timeout passed first
    closed      // the line is down; with `alwaysopen` it is being opened again
  };
  std::size_t bytes = 0;
  End end = End::done;

  [[nodiscard]] bool done() const { return end == End::done; }
  friend bool operator==(const Transfer&, const Transfer&) = default;
};

// A port for programs that wait in their calls: any port that an option string names, hardware, socket or
// tape, with nothing of the event loop to be seen. Owns the port and the loop it lives on.
//
// Drive it: create(), open(), read and write, close(); then open() again, or let it go. Nothing happens
// between calls, except in the kernel.
//
// *Threads*: any thread may call any function at any time, but finish() and the destructor, for which all
// other calls must have returned. Calls that wait do not hold up those of other threads; each has the timeout
// that was set when it began. Several readers share what comes: each read takes its bytes in one piece, skips
// do not. The bytes of several writers may be mixed where a write has to wait. The end of a line, and
// close(), end all calls that wait on that line.
//
// *Timeouts* are in microseconds of the monotonic clock: kForever waits for ever, 0 does not wait. A call
// that reads up to some end times out when nothing has come for so long, the others after so long in all. The
// option `timeout` sets them in seconds (-1, the default: for ever). read_full, write_full and an open() of a
// port that waits for its peer ignore them.
//
// *Errors*: using a port that is not open, or against its permissions, is Errc::usage; a device that cannot
// be opened Errc::device_missing; one that went away Errc::device_lost. A write that the tape of a logreader
// refuses (strictness 1 and 2) is Errc::io with the offset, what was expected and what came; the line is then
// down. `on-mismatch=warn` lets such writes pass. A wait that only a write can end is Errc::io too, in the
// thread that wrote last (or opened the port, before the first write); in others it waits for that write.
//
// *When the line goes down* what came before it can still be read; then one call ends as `closed` and the
// port is no longer open. With `alwaysopen` it stays open, and calls wait, within their timeout, until the
// line is back; it comes back, and a port that listens takes its next peer, once the rest was read, or passed
// over by a call that it does not satisfy. To a peer that has ended only its own direction writes still go,
// until a read has ended as `closed`.
//
// *Input* that was not asked for yet is kept, at most kInputLimit bytes; beyond that the peer has to wait. A
// call that times out takes nothing: what had come is there for the next one. The exceptions are skip() and
// skip_until(), which drop as they go. Ports that keep messages apart give at most one message a read().
class BlockingPort final : private PortListener {
 public:
  static constexpr Micros kForever{-1};
  static constexpr std::size_t kInputLimit = std::size_t{64} * 1024;
  static constexpr std::size_t kLongestLine = std::size_t{16} * 1024 * 1024;

  // Both spellings of parse_port(), or the options with `type` among them. Touches no device. Without a
  // logger nothing is logged.
  static Result<std::unique_ptr<BlockingPort>> create(std::string_view spec,
                                                      std::shared_ptr<spdlog::logger> log = {});
  static Result<std::unique_ptr<BlockingPort>> create(std::map<std::string, std::string> options,
                                                      std::shared_ptr<spdlog::logger> log = {});
  BlockingPort(PortSpec spec, std::shared_ptr<spdlog::logger> log);
  ~BlockingPort();

  Result<void> open();
  void close();  // drops what was not read; nothing to do when not open
  [[nodiscard]] bool is_open() const { return open_; }
  // Also true when the line is down and something that came before it is left.
  [[nodiscard]] bool readable() const;

  // What is there, at least one byte, at most `into`.
  Result<Transfer> read(std::span<Byte> into);
  Result<Transfer> read_string(std::string& into);
  // Exactly as much as `into` holds.
  Result<Transfer> read_full(std::span<Byte> into);
  // Up to and with `end`; or `into` is full.
  Result<Transfer> read_until(std::span<Byte> into, Byte end);
  // At most kLongestLine; Errc::io beyond.
  Result<Transfer> read_string_until(std::string& into, char end);
  Result<Transfer> read_line(std::string& into) { return read_string_until(into, '\n'); }
  // Reads and drops `count` bytes; or up to and with the `times`-th `end`.
  Result<Transfer> skip(std::size_t count);
  Result<Transfer> skip_until(Byte end, unsigned times = 1);
  // Bytes that read() would give without waiting; 0 when there are none.
  Result<std::size_t> bytes_available();
  // The same, after waiting for one.
  Result<Transfer> bytes_available_wait();

  // As much as the line takes within the timeout, at least one byte unless it times out.
  Result<Transfer> write(ByteView data);
  // All of it. Errc::io when a whole timeout passes without a byte being taken.
  Result<Transfer> write_full(ByteView data);
  Result<Transfer> write_string(std::string_view text) { return write_full(as_bytes(text)); }

  // Drops what has come in and what has not been sent. A logreader drops only what its tape's driver could
  // have dropped too (ReplayPort::discard).
  Result<void> flush();
  // Waits until what was written has left this machine.
  Result<Transfer> drain();

  void set_timeout(Micros timeout) { timeout_ = timeout; }
  [[nodiscard]] Micros timeout() const { return timeout_; }
  // Narrowing holds at once, widening what the device was opened for from the next open() on.
  void set_can_read(bool can) { can_read_ = can; }
  void set_can_write(bool can) { can_write_ = can; }
  [[nodiscard]] bool can_read() const { return can_read_; }
  [[nodiscard]] bool can_write() const { return can_write_; }
  [[nodiscard]] bool always_open() const { return always_open_; }
  // At once where the port is open; its tape, if it has one, tells so. A logreader takes it where its tape
  // does not tell that the device did not, and holds it against the tape (`check-settings`). Errc::usage
  // where the line has no such thing.
  Result<void> set_baud(unsigned baud);

  // Ends tape and report for good and gives the port's exit status (0: all went well, the tape is whole). The
  // destructor does the same.
  int finish();

  // Some lines for people.
  [[nodiscard]] std::string status() const;

 private:
  using Condition = LoopWait::Condition;
  class Room;

  void on_up() override;
  void on_data(ByteView data) override;
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override;
  void on_drained() override { drained_ = true; }
  void on_down(const LineDown& down) override;
  void on_finished(int exit_status) override;
  void on_complete(int exit_status) override { complete_ = exit_status; }
  Answers on_ended() override;
  [[nodiscard]] std::optional<std::size_t> unread() const override { return input_.size(); }

  [[nodiscard]] bool plays_tape() const;
  Result<void> set_line(unsigned baud);
  Result<void> make();
  void close_line();
  void release();
  int complete();
  Result<void> check_read() const;
  Result<void> check_write() const;

  Result<Transfer> write(ByteView data, Micros timeout);
  std::size_t write_some(ByteView data);
  [[nodiscard]] std::size_t unsent();

  // Waits for the condition, or for an end of the line with too little left to fulfil it.
  Result<Transfer> wait_for_input(const Condition& enough, std::size_t room, Micros timeout);
  LoopWait::End wait_on_line(const Condition& enough, std::size_t room, Micros timeout);
  std::string awaits();
  Transfer take(std::size_t count, std::span<Byte> into);
  void consumed();
  Transfer line_ended();
  [[nodiscard]] Error broken() const;
  void reopen();

  Loop loop_;
  mutable LoopWait wait_{loop_};  // whose turn guards everything but the atomic members
  std::shared_ptr<spdlog::logger> log_;
  PortSpec spec_;
  std::unique_ptr<Port> port_;
  InputBuffer input_;
  std::size_t input_limit_ = kInputLimit;
  unsigned waiting_reads_ = 0;
  std::uint64_t line_ = 0;    // changes with each line that is opened, closed or found to have ended
  std::uint64_t writer_ = 0;  // the thread of the last write or open()
  std::optional<LineDown> down_;
  std::optional<int> complete_;  // the port's exit status, once finish() is done
  Timer retry_;
  Nanos retry_after_{};
  std::atomic<Micros> timeout_ = kForever;
  std::atomic<bool> can_read_ = true;
  std::atomic<bool> can_write_ = true;
  bool always_open_ = false;
  std::atomic<bool> open_ = false;
  bool opening_ = false;     // open() waits
  bool completing_ = false;  // complete() waits
  bool up_ = false;
  bool came_up_ = false;  // since open()
  bool drained_ = false;
  bool reading_ = true;
  bool reopen_owed_ = false;  // alwaysopen: once what the old line left is read or passed over
  bool ended_ = false;        // the peer sends no more
  std::uint64_t read_bytes_ = 0;
  std::uint64_t written_bytes_ = 0;
};

}  // namespace porttape
