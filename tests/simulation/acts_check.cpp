#include "tests/simulation/acts_check.hpp"

#include <algorithm>
#include <cstdint>
#include <fmt/format.h>
#include <map>
#include <optional>
#include <vector>

#include "libport/line/line_settings_text.hpp"

namespace porttape::simulation {
namespace {

using What = Passed::What;

// An act of the driver, and what became of it.
struct Told {
  const Passed* act = nullptr;
  std::uint64_t bytes = 0;  // that the driver wrote before it, in its session
  bool due = false;         // the device was there for it
  std::uint64_t seen = 0;   // when it reached the device's port; 0: it did not
  bool answered = false;
};

struct DriverSession {
  std::vector<Told> acts;
  std::uint64_t bytes = 0;
  bool over = false;
};

bool is_act(What what) { return what >= What::signal && what <= What::ask; }

std::string text_of(const Passed& act) {
  switch (act.what) {
    case What::signal:
      return fmt::format("{} {}", porttape::name_of(act.signal.name), act.signal.on ? "on" : "off");
    case What::settings:
    case What::peer_set:
      return to_text(act.settings);
    case What::flush:
      return fmt::format("a flush of {}", name_of(act.queue));
    case What::drain:
      return "a drain";
    case What::ask:
      return fmt::format("question {}", static_cast<int>(act.request.kind));
    default:
      return "something";
  }
}

// Whether the device's port was told of this act.
bool is_same(const Passed& told, const Passed& seen) {
  const What what = seen.what == What::peer_set ? What::settings : seen.what;
  return told.what == what && told.signal == seen.signal && told.settings == seen.settings &&
         told.queue == seen.queue && told.request.kind == seen.request.kind;
}

// Whether the second act may not overtake the first. port.hpp: a signal comes after all that came before, a
// question after all that was written, set and signalled.
bool keeps_order(What first, What second) {
  if (second == What::signal || second == What::ask) return first != What::flush && first != What::drain;
  return first == second;
}

class ActsCheck {
 public:
  ActsCheck(World& world, const std::string& name, const Line& driver, const Line& device, bool exact,
            Instant end)
      : world_(&world), name_(&name), driver_(&driver), device_(&device), exact_(exact), end_(end) {}

  void run() {
    auto next_driver = driver_->passed.begin();
    auto next_device = device_->passed.begin();
    while (next_driver != driver_->passed.end() || next_device != device_->passed.end()) {
      const bool driver_first =
          next_device == device_->passed.end() ||
          (next_driver != driver_->passed.end() && next_driver->serial < next_device->serial);
      if (driver_first) {
        at_driver(*next_driver++);
      } else {
        at_device(*next_device++);
      }
    }
    for (const DriverSession& session : sessions_) check_session(session);
    if (driver_->unanswered() > 0)
      wrong("{} drains and questions of the driver are never answered", driver_->unanswered());
  }

 private:
  template <class... Args>
  void wrong(fmt::format_string<Args...> text, Args&&... args) {
    world_->wrong("{}: {}", *name_, fmt::format(text, std::forward<Args>(args)...));
  }

  void at_driver(const Passed& passed) {
    if (!passed.to_listener) return by_session(passed);
    if (passed.what == What::up) {
      sessions_.emplace_back();
      driver_up_ = true;
      to_driver_ = 0;
    } else if (passed.what == What::down) {
      driver_leaves();
    } else if (passed.what == What::data) {
      sessions_.back().bytes += passed.data.size();
    } else if (is_act(passed.what)) {
      DriverSession& session = sessions_.back();
      session.acts.push_back({.act = &passed, .bytes = session.bytes, .due = device_serves_driver()});
    }
  }

  void driver_leaves() {
    driver_up_ = false;
    if (!sessions_.empty()) sessions_.back().over = true;
    signals_.clear();
  }

  void by_session(const Passed& passed) {
    switch (passed.what) {
      case What::close:
        return driver_leaves();
      case What::data:
        to_driver_ += passed.data.size();
        return;
      case What::drained:
      case What::answered:
        return answered(passed);
      case What::signal:
        return shown(passed);
      default:
        return;
    }
  }

  void at_device(const Passed& passed) {
    if (passed.to_listener) return by_device(passed);
    check_followed(passed);
    switch (passed.what) {
      case What::open:
        if (exact_ && !driver_up_) wrong("the device is opened, and no driver is there");
        serves_ = sessions_.empty() ? 0 : sessions_.size() - 1;
        settings_ = {};
        device_gone_ = false;
        to_device_ = 0;
        return;
      case What::close:
        device_up_ = false;
        signals_.clear();
        return;
      case What::data:
        to_device_ += passed.data.size();
        return;
      case What::settings:
        return;  // check_followed()
      default:
        if (is_act(passed.what) || passed.what == What::peer_set) take(passed);
    }
  }

  void by_device(const Passed& passed) {
    switch (passed.what) {
      case What::up:
        device_up_ = true;
        device_gone_ = false;
        if (!device_serves_driver()) return;
        for (Told& each : sessions_.back().acts)
          each.due = each.due || (!each.answered && each.act->what != What::flush);
        return;
      case What::down:
        device_up_ = false;
        device_gone_ = true;
        follows_.reset();
        signals_.clear();
        return;
      case What::data:
        if (driver_up_) from_device_ += passed.data.size();
        return;
      case What::signal:
        if (driver_up_) signals_.push_back(&passed);
        return;
      case What::drained:
      case What::answered:
        answers_[passed.number] = true;
        return;
      default:
        return;
    }
  }

  // The driver that the device was opened for is there, and so is the device.
  [[nodiscard]] bool device_serves_driver() const {
    return device_up_ && driver_up_ && serves_ + 1 == sessions_.size();
  }

  // The device's port is told of an act: whose is it?
  void take(const Passed& passed) {
    if (serves_ >= sessions_.size()) return wrong("the device gets {} from nobody", text_of(passed));
    // A fault may keep the device's port from being opened for a driver.
    Told* found = nullptr;
    for (std::size_t n = sessions_.size(); n-- > 0 && found == nullptr;) {
      if (n == serves_ || !exact_) found = find(sessions_[n], passed);
    }
    if (found == nullptr && is_of_early_flushes(passed)) return;
    if (found == nullptr) return wrong("the device gets {}, which its driver did not do", text_of(passed));
    found->seen = passed.serial;
    if (exact_ && passed.what == What::flush && !found->due) (void)see_early_flushes(passed);
    if (passed.number > 0) asked_[found->act->number] = passed.number;
    if (exact_ && found->act->at < end_ && found->bytes != to_device_)
      wrong("the device gets {} after {} bytes, the driver did it after {}", text_of(passed), to_device_,
            found->bytes);
    if (passed.what == What::peer_set && device_->kind().serial && !device_gone_) {
      const LineSettings wanted = passed.settings.over(settings_);
      if (wanted != settings_) follows_ = wanted;
    }
  }

  // Flushes that the device was not there for are one, of all their queues.
  bool is_of_early_flushes(const Passed& passed) {
    if (passed.what != What::flush || passed.queue != FlushQueue::both) return false;
    return !exact_ || see_early_flushes(passed) > 1;
  }

  int see_early_flushes(const Passed& passed) {
    int flushes = 0;
    for (Told& each : sessions_[serves_].acts) {
      if (each.act->what != What::flush || each.seen != 0 || each.due) continue;
      each.seen = passed.serial;
      ++flushes;
    }
    return flushes;
  }

  // Of acts that are alike the first one in its place is meant, of settings the last one: it replaces those
  // that the device was not there for.
  Told* find(DriverSession& session, const Passed& passed) const {
    Told* found = nullptr;
    for (Told& each : session.acts) {
      if (each.seen != 0 || !is_same(*each.act, passed)) continue;
      const bool better = found == nullptr || passed.what == What::peer_set ||
                          (found->bytes != to_device_ && each.bytes == to_device_);
      if (better) found = &each;
    }
    return found;
  }

  // What the driver has made of its line, the device's line is made next, where it differs.
  void check_followed(const Passed& passed) {
    const std::optional<LineSettings> wanted = std::exchange(follows_, std::nullopt);
    const bool made = passed.what == What::settings;
    if (!exact_ || device_gone_ || (!wanted && !made)) return;
    if (!made || !wanted || SeenSettings::of(*wanted) != passed.settings)
      return wrong("the driver has made its line {}, the device is made {}",
                   wanted ? to_text(SeenSettings::of(*wanted)) : "no other",
                   made ? to_text(passed.settings) : "no other");
    settings_ = *wanted;
  }

  // A drain or a question of the driver is answered.
  void answered(const Passed& passed) {
    for (DriverSession& session : sessions_) {
      for (Told& each : session.acts) {
        if (each.act->number != passed.number) continue;
        each.answered = true;
        const auto asked = asked_.find(passed.number);
        const bool by_device = asked != asked_.end() && answers_.contains(asked->second);
        const bool may_ask = &session == &sessions_.back() && device_serves_driver();
        if (exact_ && !by_device && (asked != asked_.end() || may_ask))
          wrong("{} of the driver is answered, and the device has not done so", text_of(*each.act));
      }
    }
  }

  // A signal of the device is shown to the driver.
  void shown(const Passed& passed) {
    if (!exact_) return;
    if (signals_.empty() || signals_.front()->signal != passed.signal)
      return wrong("the driver is shown {}, which the device did not do next", text_of(passed));
    signals_.erase(signals_.begin());
    if (!signals_.empty()) wrong("the driver is shown {} late", text_of(passed));
  }

  void check_session(const DriverSession& session) {
    for (std::size_t n = 0; n < session.acts.size(); ++n) {
      const Told& each = session.acts[n];
      const auto overtaken = std::find_if(
          session.acts.begin(), session.acts.begin() + static_cast<std::ptrdiff_t>(n),
          [&each](const Told& first) {
            return each.seen != 0 && first.seen > each.seen && keeps_order(first.act->what, each.act->what);
          });
      if (exact_ && overtaken != session.acts.begin() + static_cast<std::ptrdiff_t>(n))
        wrong("{} of the driver overtook {}", text_of(*each.act), text_of(*overtaken->act));
      if (exact_ && each.due && each.seen == 0 && !is_replaced(session, n))
        wrong("{} of the driver, after its byte {}, did not reach the device", text_of(*each.act),
              each.bytes);
    }
  }

  // Of settings that were made before the device was there the last ones are enough.
  static bool is_replaced(const DriverSession& session, std::size_t act) {
    if (session.acts[act].act->what != What::settings) return false;
    return std::any_of(session.acts.begin() + static_cast<std::ptrdiff_t>(act) + 1, session.acts.end(),
                       [&](const Told& later) {
                         return later.act->what == What::settings && later.bytes == session.acts[act].bytes;
                       });
  }

  World* world_;
  const std::string* name_;
  const Line* driver_;
  const Line* device_;
  bool exact_;
  Instant end_;
  std::vector<DriverSession> sessions_;
  bool driver_up_ = false;
  bool device_up_ = false;
  bool device_gone_ = false;  // in this session
  std::size_t serves_ = 0;    // the session for which the device was opened last
  std::uint64_t to_device_ = 0;
  std::uint64_t to_driver_ = 0;
  std::uint64_t from_device_ = 0;
  LineSettings settings_;                         // of the device
  std::optional<LineSettings> follows_;           // the device is to be made so
  std::vector<const Passed*> signals_;            // of the device, that the driver was not shown
  std::map<std::uint64_t, std::uint64_t> asked_;  // of the driver's drains and questions: the device's
  std::map<std::uint64_t, bool> answers_;         // that the device gave
};

}  // namespace

void check_acts(World& world, const std::string& name, const Line& driver, const Line& device, bool exact,
                Instant end) {
  ActsCheck(world, name, driver, device, exact, end).run();
}

}  // namespace porttape::simulation
