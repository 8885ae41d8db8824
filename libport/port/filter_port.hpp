#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "libport/port/context.hpp"
#include "libport/port/forwarding_port.hpp"
#include "libport/port/lane.hpp"

namespace porttape {

// A port around another that changes, delays or drops what passes. Whatever way bytes take, each arrival is
// one incoming(), each write one outgoing(); a subclass overrides these and passes on what it likes with
// deliver() and send(), now or later, which keep the order.
//
// What is held back:
// - An event of the line, of either side, keeps its place among the bytes if it has one (keeps_place). The
//   line goes down after the last byte.
// - It is congested while a write is held, since a session closes a line that is not: with delayed writes a
//   caller has one on its way at a time.
// - An end of writing, a hang-up and new settings wait for no `due`, and held writes go out before them: at
//   once as far as the inner port takes them, else they wait behind the last one. A hang-up at once drops the
//   rest. Nor do the peer's end of writing and read_pending() wait for a `due`. Behind bytes that are not
//   read, the inner port decides which answer to an ended peer is the last.
// - While nothing is read bytes wait, and with them a line that its peer has closed: while the other line
// takes
//   bytes, and 10 s without that; one that breaks takes them with it, as the kernel's queue goes with a
//   device.
// - Held writes wait while the line is interrupted. They are dropped when it goes down, since they are not
//   the next peer's, and at close() with all else.
// What is dropped is told, except to the one who asks for it by discard(). Arrivals that came together and
// are passed on at once stay together.
//
// A subclass breaks the line by hang_up(), or by close() and listener().on_down(). drop() is for what this
// program loses; what shall look like a loss of the line's own is just not passed on.
class FilterPort : public ForwardingPort {
 public:
  // So many bytes may wait to be delivered; the inner port is not read meanwhile.
  static constexpr std::size_t kMostWaiting = std::size_t{256} << 10;

  FilterPort(const PortContext& context, std::unique_ptr<Port> inner);

  void close() override;
  void write(ByteView data) final { outgoing(data); }
  [[nodiscard]] bool congested() const final { return !out_.empty() || ForwardingPort::congested(); }
  bool end_writing() final;
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const final;
  // Settings that wait behind held writes count as the line's. If the inner port refuses them later,
  // a line::Settings tells those that it has kept.
  [[nodiscard]] std::optional<LineSettings> settings() const final;
  Result<void> apply(const LineSettings& settings) final;
  void tell(const LineEvent& event) final;
  void set_reading(bool on) final;
  void hang_up(bool after_reading) final;
  void read_pending() final;
  void finish() final;
  // Always: bytes may be held here.
  [[nodiscard]] PortFacets facets() final {
    PortFacets facets = ForwardingPort::facets();
    facets.waiting = this;
    return facets;
  }

 protected:
  virtual void incoming(ByteView arrival) { deliver(arrival); }
  virtual void outgoing(ByteView data) { send(data); }
  [[nodiscard]] Instant now() const { return loop_->now(); }
  // To the listener, and to the inner port: not before `due`, nor before what was given sooner.
  void deliver(ByteView arrival, Instant due = {});
  void send(ByteView data, Instant due = {});
  // Bytes that will not be delivered or sent.
  void drop(std::uint64_t bytes, std::string_view why) { ForwardingPort::told(line::Dropped{bytes, why}); }
  // So many held bytes go with the line.
  virtual void lose_held(std::uint64_t bytes, std::string_view why) { drop(bytes, why); }

  void on_up() override;
  [[nodiscard]] std::optional<Instant> next_due() override;

 private:
  // Arrivals that are passed on within one call of on_arrivals().
  struct Together {
    Bytes data;
    std::vector<std::size_t> ends;
  };

  void on_data(ByteView data) final { incoming(data); }
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) final;
  void on_drained() final;
  void on_down(const LineDown& down) final;
  Answers on_ended() final;
  bool wants_rest() final;
  [[nodiscard]] std::optional<std::size_t> unread() const final;
  void on_interrupted(const LineDown& down) final;
  void on_resumed() final;
  void told(const LineEvent& event) final;
  void on_finished(int exit_status) final;

  std::size_t write_some(ByteView data) final;
  [[nodiscard]] std::size_t unsent() final { return out_.bytes() + ForwardingPort::unsent(); }
  bool discard() final;

  void pass(ByteView data);
  void pass_together();
  void let_inner_read();
  void drop_held(Lane& lane, std::string_view why);
  void drop_writes(std::string_view why);
  void end_behind_writes(std::function<void()> end);
  void apply_waiting();

  Loop* loop_;
  std::optional<Together> together_;
  Lane in_;
  Lane out_;
  bool reading_ = true;
  bool inner_reads_ = true;
  bool interrupted_ = false;   // the inner port's line, whether or not that is told yet
  std::function<void()> end_;  // end_writing() or hang_up() of the inner port, behind held writes
  std::deque<LineSettings> settings_waiting_;
  int downs_untold_ = 0;
  unsigned closes_ = 0;
};

}  // namespace porttape
