#include "tests/simulation/hall.hpp"

#include <optional>
#include <utility>

#include "tests/simulation/checked_port.hpp"
#include "tests/simulation/line_port.hpp"

namespace porttape::simulation {

// What the port of a listening socket does.
class HallPort final : public Port, private ConnectionSource {
 public:
  explicit HallPort(Hall& hall) : hall_(&hall) { hall.port_ = this; }
  ~HallPort() override { hall_->port_ = nullptr; }

  Result<void> prepare() override { return {}; }
  void open() override { accepting_ = true; }
  void close() override { accepting_ = false; }
  void write(ByteView) override { hall_->world_->wrong("{}: bytes are written to it", hall_->name_); }
  [[nodiscard]] bool congested() const override { return false; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return std::nullopt; }
  bool end_writing() override { return false; }
  void read_pending() override {}
  void set_reading(bool) override {}
  void hang_up(bool) override {}
  void finish() override { listener().on_complete(0); }
  [[nodiscard]] PortTraits traits() const override { return {.passive = true}; }
  [[nodiscard]] std::string name() const override { return hall_->name_; }
  [[nodiscard]] PortFacets facets() override { return {.connections = this}; }

  bool connect(Line& line) {
    if (!accepting_ || !take_) return false;
    line.open();
    World& world = *hall_->world_;
    take_(std::make_unique<CheckedPort>(world, std::make_unique<LinePort>(world, line), false), line.name());
    return true;
  }

 private:
  void give_each(TakeConnection take) override { take_ = std::move(take); }
  [[nodiscard]] std::size_t most_connections() const override { return 256; }

  Hall* hall_;
  TakeConnection take_;
  bool accepting_ = false;
};

bool Hall::connect(Line& line) { return port_ != nullptr && port_->connect(line); }

std::unique_ptr<Port> Hall::make_port() { return std::make_unique<HallPort>(*this); }

}  // namespace porttape::simulation
