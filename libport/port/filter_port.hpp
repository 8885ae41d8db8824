#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/forwarding_port.hpp"

namespace porttape {

// A port around another that changes, delays or drops what passes. Whatever way bytes take, each arrival is
// one incoming(), each write one outgoing(); a subclass overrides these and passes on what it likes with
// deliver() and send(), now or later, which keep the order. Events of the line keep their place among what
// is delivered: it goes down after the last byte. As on any port bytes that wait to be sent make it
// congested, and those that wait at a close are dropped and told.
class FilterPort : public ForwardingPort {
 public:
  // So many bytes may wait to be delivered; the inner port is not read meanwhile.
  static constexpr std::size_t kMostWaiting = std::size_t{256} << 10;

  FilterPort(const PortContext& context, std::unique_ptr<Port> inner);

  void close() final;
  void write(ByteView data) final { outgoing(data); }
  [[nodiscard]] bool congested() const final;
  bool end_writing() final;
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const final;
  void set_reading(bool on) final;
  void hang_up(bool after_reading) final;
  void read_pending() final;

 protected:
  virtual void incoming(ByteView arrival) { deliver(arrival); }
  virtual void outgoing(ByteView data) { send(data); }
  // To the listener, and to the inner port: not before `due`, nor before what was given sooner. An end of
  // writing, a hang-up and read_pending() do not wait for `due`.
  void deliver(ByteView arrival, Instant due = {});
  void send(ByteView data, Instant due = {});
  // Bytes that will not be delivered or sent.
  void drop(std::uint64_t bytes, std::string_view why);

 private:
  struct Step {
    Instant due;
    Bytes data;                   // to be passed on, or
    std::function<void()> event;  // to be told
  };
  struct Lane {
    Timer timer;
    std::deque<Step> steps = {};
    std::size_t bytes = 0;
  };
  enum class When { due, now };

  void on_data(ByteView data) final { incoming(data); }
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) final;
  void on_up() final;
  void on_drained() final;
  void on_down(const LineDown& down) final;
  Answers on_ended() final;
  void on_interrupted(const LineDown& down) final;
  void on_resumed() final;
  void on_settings(const SeenSettings& settings) final;
  void on_dropped(std::uint64_t bytes, std::string_view why) final;

  std::size_t write_some(ByteView data) final;
  [[nodiscard]] std::size_t unsent() final { return ForwardingPort::unsent() + out_.bytes; }
  bool discard() final;
  [[nodiscard]] std::optional<Instant> next_due() final;

  void tell(std::function<void()> event);
  static void put(Lane& lane, Step step);
  static Step take(Lane& lane);
  static bool is_due(const Lane& lane, When when);
  void run_in(When when);
  void run_out(When when);
  void let_inner_read();

  Lane in_;
  Lane out_;
  bool reading_ = true;
  bool inner_reads_ = true;
};

}  // namespace porttape
