#include "libport/supervise/tapped_line.hpp"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "libport/tty/device_identity.hpp"

namespace porttape {

// The driver's end: up while the driver has its device open.
class TappedLine::Driver final : public Port {
 public:
  explicit Driver(TappedLine& line) : line_(&line) {}
  ~Driver() override {
    if (line_ != nullptr) line_->driver_ = nullptr;
  }
  void line_gone() { line_ = nullptr; }

  Result<void> prepare() override { return {}; }
  void open() override {
    accepting_ = true;
    if (line_ != nullptr && line_->open_) come_up();
  }
  void close() override { accepting_ = up_ = false; }
  void write(ByteView) override {}  // the driver has it
  [[nodiscard]] bool congested() const override { return false; }
  bool end_writing() override { return false; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return 0; }
  void set_reading(bool on) override { reading_ = on; }
  void hang_up(bool) override {}
  void read_pending() override {}
  [[nodiscard]] PortTraits traits() const override { return {.passive = true, .shows_signals = true}; }
  [[nodiscard]] std::string name() const override { return "the command"; }
  [[nodiscard]] PortPlace place() const override {
    return {.path = line_ != nullptr ? line_->device_path_ : std::string()};
  }

  void come_up() {
    if (!accepting_ || up_) return;
    up_ = true;
    listener().on_up();
  }
  void go_down() {
    if (std::exchange(up_, false)) listener().on_down({.reason = LineDown::Reason::closed, .error = {}});
  }
  [[nodiscard]] bool up() const { return up_; }
  [[nodiscard]] PortListener& hears() const { return listener(); }

 private:
  TappedLine* line_;
  bool accepting_ = false;
  bool up_ = false;
  bool reading_ = true;
};

// The device's end: up as soon as it is asked, since the driver has opened it.
class TappedLine::Device final : public Port {
 public:
  explicit Device(TappedLine& line) : line_(&line) {}
  ~Device() override {
    if (line_ != nullptr) line_->device_ = nullptr;
  }
  void line_gone() { line_ = nullptr; }

  Result<void> prepare() override { return {}; }
  void open() override {
    up_ = true;
    listener().on_up();
    for (const auto& say : std::exchange(early_, {})) {
      if (up_) say(listener());
    }
  }
  void close() override {
    up_ = false;
    early_.clear();
    end_drains();
  }
  void write(ByteView) override {}  // it has it
  [[nodiscard]] bool congested() const override { return false; }
  bool end_writing() override { return false; }
  [[nodiscard]] std::optional<std::size_t> unread_by_peer() const override { return std::nullopt; }
  [[nodiscard]] std::optional<LineSettings> settings() const override {
    return line_ != nullptr ? std::optional(line_->settings_) : std::nullopt;
  }
  Result<void> apply(const LineSettings&) override { return {}; }  // the driver has done so
  void tell(const LineEvent& event) override {
    const auto* const drain = std::get_if<line::Drain>(&event);
    if (drain == nullptr || !up_) return Port::tell(event);
    drains_.push_back(drain->number);
  }
  void set_reading(bool) override {}
  void hang_up(bool) override {}
  void read_pending() override {}
  [[nodiscard]] PortTraits traits() const override { return {.shows_signals = true}; }
  [[nodiscard]] std::string name() const override {
    return line_ != nullptr && !line_->name_.empty() ? line_->device_name() : "the command's device";
  }
  [[nodiscard]] std::optional<PortIdentity> identity() const override {
    return line_ != nullptr && !line_->name_.empty() ? identity_of(line_->name_) : std::nullopt;
  }

  [[nodiscard]] bool up() const { return up_; }
  [[nodiscard]] PortListener& hears() const { return listener(); }
  // At once, or when it is asked to open: the driver has it by then.
  void say(const std::function<void(PortListener&)>& say) {
    if (up_) return say(listener());
    if (line_ != nullptr && line_->open_ && !line_->lost_) early_.push_back(say);
  }
  // The same, though the device may be lost.
  void note(const std::function<void(PortListener&)>& say) {
    if (up_ || (line_ != nullptr && line_->lost_)) return say(listener());
    early_.push_back(say);
  }
  void end_drains() {
    for (const RequestNumber number : std::exchange(drains_, {})) listener().told(line::Sent{number});
  }
  void lose(const std::string& why) {
    up_ = false;
    end_drains();
    listener().on_down({.reason = LineDown::Reason::lost, .error = make_error(Errc::device_lost, why)});
  }

 private:
  TappedLine* line_;
  std::vector<RequestNumber> drains_;
  std::vector<std::function<void(PortListener&)>> early_;
  bool up_ = false;
};

TappedLine::TappedLine(std::string device) : device_path_(std::move(device)) {}

TappedLine::~TappedLine() {
  if (driver_ != nullptr) driver_->line_gone();
  if (device_ != nullptr) device_->line_gone();
}

std::unique_ptr<Port> TappedLine::driver_port() {
  auto port = std::make_unique<Driver>(*this);
  driver_ = port.get();
  return port;
}

std::unique_ptr<Port> TappedLine::device_port() {
  auto port = std::make_unique<Device>(*this);
  device_ = port.get();
  return port;
}

void TappedLine::opened(const std::string& device, const LineSettings& settings) {
  name_ = device;
  settings_ = settings;
  open_ = true;
  lost_ = false;
  if (driver_ != nullptr) driver_->come_up();
  for (const std::string& why : unseen_) note_unseen(why);
}

void TappedLine::closed() {
  open_ = false;
  unseen_.clear();
  if (driver_ != nullptr) driver_->go_down();
}

void TappedLine::unseen(const std::string& why) {
  was_unseen_ = true;
  if (std::ranges::find(unseen_, why) != unseen_.end()) return;
  unseen_.push_back(why);
  if (open_) note_unseen(why);
}

void TappedLine::note_unseen(const std::string& why) {
  if (device_ == nullptr) return;
  device_->note([why](PortListener& hears) { hears.told(line::Dropped{0, why}); });
}

void TappedLine::wrote(ByteView data) {
  if (driver_ != nullptr && driver_->up()) driver_->hears().on_data(data);
}

void TappedLine::got(ByteView data) {
  if (device_ == nullptr) return;
  if (device_->up()) return device_->hears().on_data(data);
  device_->say([bytes = Bytes(data.begin(), data.end())](PortListener& hears) { hears.on_data(bytes); });
}

void TappedLine::made(const LineSettings& settings) {
  settings_ = settings;
  driver_did(line::Settings{SeenSettings::of(settings)});
}

void TappedLine::driver_did(const LineEvent& event) {
  if (driver_ != nullptr && driver_->up()) driver_->hears().told(event);
}

void TappedLine::device_did(const LineEvent& event) {
  if (device_ != nullptr) device_->say([event](PortListener& hears) { hears.told(event); });
}

std::function<void()> TappedLine::drains() {
  if (driver_ == nullptr || !driver_->up()) return [] {};
  driver_->hears().told(line::Drain{++drains_});
  return [this] {
    if (device_ != nullptr) device_->end_drains();
  };
}

void TappedLine::lost(const std::string& why) {
  if (!open_ || lost_ || device_ == nullptr) return;
  const std::string text = device_name() + ": " + why;
  if (!device_->up()) device_->say([device = device_, text](PortListener&) { device->lose(text); });
  lost_ = true;
  if (device_->up()) device_->lose(text);
}

}  // namespace porttape
