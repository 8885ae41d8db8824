#pragma once

#include <memory>

#include "libport/port/forwarding_port.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// Stands between a session and one of its ports (with all its wrappers) and reports to the world when either
// of them breaks what libport/port/port.hpp promises about the order of calls. Changes nothing.
//
// A port that makes faults (`lenient`) holds events back, and may report them, delayed bytes and a second
// interruption while its line is not up. README.md lists that as an open question.
class CheckedPort final : public ForwardingPort {
 public:
  CheckedPort(World& world, std::unique_ptr<Port> inner, bool lenient);

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  bool end_writing() override;
  void set_reading(bool on) override;
  void finish() override;
  [[nodiscard]] PortFacets facets() override {
    PortFacets facets = ForwardingPort::facets();
    facets.connections = inner().connections();
    return facets;
  }

 private:
  void on_up() override;
  void on_data(ByteView data) override;
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override;
  void on_drained() override;
  void on_down(const LineDown& down) override;
  void on_complete(int exit_status) override;
  Answers on_ended() override;
  void on_interrupted(const LineDown& down) override;
  void on_resumed() override;
  void told(const LineEvent& event) override;

  // Reports `what` unless it is `allowed`.
  void expect(bool allowed, const char* what);
  void expect_up(const char* what);
  void expect_data();

  World* world_;
  bool lenient_;
  bool prepared_ = false;
  bool opened_ = false;  // by open(), not closed since
  bool up_ = false;
  bool reading_ = true;
  bool was_congested_ = false;  // seen since the last on_drained
  bool writing_ended_ = false;  // in this session
  bool ended_ = false;          // the peer's sending, while the line is up
  bool interrupted_ = false;
  bool finished_ = false;
  bool completed_ = false;
};

}  // namespace porttape::simulation
