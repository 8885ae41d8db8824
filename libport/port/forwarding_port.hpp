#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "libport/port/port.hpp"

namespace porttape {

// A port around another, which it owns: passes on every call of Port, PortListener and WaitingCalls. A
// wrapper (a tap, a fault, a filter) derives from it, overrides what it means and calls the function of this
// class to pass on: one that changes what is written overrides write() and write_some(), which BlockingPort
// calls. A call that is new in an interface is added here, and no wrapper forgets it.
class ForwardingPort : public Port, protected PortListener, protected WaitingCalls {
 public:
  explicit ForwardingPort(std::unique_ptr<Port> inner);

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  [[nodiscard]] bool congested() const override;
  bool end_writing() override;
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override;
  [[nodiscard]] std::optional<LineSettings> settings() const override;
  Result<void> apply(const LineSettings& settings) override;
  void tell(const LineEvent& event) override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  [[nodiscard]] bool left_bytes() const override;
  void finish() override;
  // The calls of waiting programs are this one's, where the inner port has them. Connections that the inner
  // port gives away would not be wrapped: none are given.
  [[nodiscard]] PortFacets facets() override;
  [[nodiscard]] PortTraits traits() const override;
  [[nodiscard]] std::string name() const override;
  [[nodiscard]] PortPlace place() const override;
  [[nodiscard]] std::optional<PortIdentity> identity() const override;

 protected:
  [[nodiscard]] Port& inner() { return *inner_; }
  [[nodiscard]] const Port& inner() const { return *inner_; }

  void on_up() override;
  void on_data(ByteView data) override;
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override;
  void on_drained() override;
  void on_down(const LineDown& down) override;
  void on_finished(int exit_status) override;
  void on_complete(int exit_status) override;
  Answers on_ended() override;
  [[nodiscard]] bool half_closes() const override;
  [[nodiscard]] std::optional<std::size_t> unread() const override;
  bool wants_rest() override;
  void on_interrupted(const LineDown& down) override;
  void on_resumed() override;
  void told(const LineEvent& event) override;

  // Where the inner port has none of them: what WaitingCalls says of such a port.
  std::size_t write_some(ByteView data) override;
  [[nodiscard]] std::size_t unsent() override;
  bool discard() override;
  [[nodiscard]] std::string awaits() override;
  [[nodiscard]] std::optional<Instant> next_due() override;

 private:
  std::unique_ptr<Port> inner_;
};

}  // namespace porttape
