#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "libport/port/port.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

class LinePort;

// A line with a program or a device at its far end, and what passed on it. The near end is a LinePort; while
// there is none (between two sessions) the far end waits.
class Line {
 public:
  struct Kind {
    bool passive = false;         // it is a driver's line, or a device that connects
    bool half_closes = false;     // as sockets do
    bool knows_unread = false;    // unread_by_peer() tells
    bool always_open = false;     // an interruption is mended by the port
    std::size_t capacity = 4096;  // bytes that the system takes on the way to the far end, and from it

    // As chance wants them.
    static Kind of_driver(World& world);
    static Kind of_device(World& world);
  };

  Line(World& world, std::string name, Kind kind) : world_(&world), name_(std::move(name)), kind_(kind) {}
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  // The far end. A driver opens and closes; a device is there or is not.
  void open();
  void close();
  // Takes what fits; how much that was.
  std::size_t send(ByteView data);
  // Up to `most` of what came; gives it to on_read.
  void read(std::size_t most);
  void half_close();
  void flush_input();  // drops what came and was not read
  void set(const SeenSettings& settings);
  void unplug();  // a device
  void plug_in();

  [[nodiscard]] bool is_open() const { return open_; }
  [[nodiscard]] std::size_t unread() const { return to_far_.size(); }
  [[nodiscard]] std::size_t unsent() const { return to_near_.size(); }
  [[nodiscard]] bool near_ended() const { return near_ended_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const Kind& kind() const { return kind_; }

  std::function<void(ByteView)> on_read = [](ByteView) {};
  std::function<void()> on_readable = [] {};  // something came for the far end
  std::function<void()> on_broken = [] {};    // the near end closed it or hung up

  // In order, what the port and its listener gave each other.
  struct Passed {
    bool to_listener;
    Bytes data;
  };
  std::vector<Passed> passed;
  std::uint64_t bytes_in = 0;       // to the listener
  std::uint64_t bytes_out = 0;      // from it
  std::uint64_t bytes_dropped = 0;  // told by on_dropped
  std::uint64_t bytes_unread = 0;   // at the end, as unread_by_peer() told
  std::size_t most_kept = 0;        // bytes for the far end beyond the capacity, at most

 private:
  friend class LinePort;
  void broken();

  World* world_;
  std::string name_;
  Kind kind_;
  LinePort* port_ = nullptr;
  bool open_ = false;
  bool ended_ = false;       // the far end sends no more
  bool near_ended_ = false;  // the near end sends no more
  bool closing_ = false;     // the far end has closed; the near end has not seen it yet
  Bytes to_near_;
  Bytes to_far_;
  std::optional<SeenSettings> set_;  // by the far end, and not seen by the near end yet
};

// The near end: what a pty's, a tty's or a socket's port does, without the system.
class LinePort final : public Port {
 public:
  LinePort(World& world, Line& line);
  ~LinePort() override;

  Result<void> prepare() override { return {}; }
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override { return line_->to_far_.size() > line_->kind_.capacity; }
  bool end_writing() override;
  [[nodiscard]] bool has_half_close() const override { return line_->kind_.half_closes; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] bool passive() const override { return line_->kind_.passive; }
  [[nodiscard]] bool keeps_datagrams() const override { return false; }
  [[nodiscard]] std::string name() const override { return line_->name_; }

 private:
  friend class Line;
  void soon();
  void look();
  void deliver(std::size_t most);
  void come_up();
  void go_down(LineDown::Reason reason);
  void far_read();
  void drop_unsent();

  World* world_;
  Line* line_;
  Timer timer_;
  bool accepting_ = false;
  bool up_ = false;
  bool interrupted_ = false;
  bool reading_ = true;
  bool leaving_ = false;  // hang_up(true), and bytes are unread
  bool asked_ = false;    // on_ended was told
  bool was_congested_ = false;
  std::optional<Instant> gone_since_;
  std::optional<PortListener::Answers> answers_;
  Instant quiet_since_{};
};

}  // namespace porttape::simulation
