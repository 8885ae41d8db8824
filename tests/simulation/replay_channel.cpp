#include "tests/simulation/replay_channel.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <utility>

#include "libport/tape/tape_writer.hpp"
#include "tests/simulation/catalog.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;

}  // namespace

ReplayChannel::ReplayChannel(World& world, std::string name)
    : Channel(world, std::move(name)),
      driver_does_(static_cast<Driver>(std::max<std::int64_t>(0, world.between(-3, 2)))),
      driver_(world, this->name() + "-driver", Line::Kind::of_driver(world)) {
  put_up(world, driver_);
  make_tape();
  driver_.on_read = [this](ByteView data) { take_in(data); };
  driver_.on_readable = [this] { act(); };
}

ChannelSpec ReplayChannel::spec() const {
  OptionValues values{{"driver", "memory:" + driver_.name()},
                      {"tape", (world().folder() / (name() + ".log")).string()},
                      {"report", report().string()},
                      {"chunks", chunks()},
                      {"once", "1"}};
  values.insert(by_lookup() ? std::pair("match", "lookup") : std::pair("check-settings", "1"));
  if (expected_.size() % 5 == 1) values.insert({"faults", "drop:p=0;delay:p=0;hangup:p=0"});
  if (resyncs()) values.insert({"on-mismatch", "resync"});
  return {ChannelMode::replay, std::move(values)};
}

// How it is played hangs on what is on the tape.
std::string ReplayChannel::chunks() const {
  constexpr std::array kinds = {"auto", "bytes", "auto", "random:7"};
  return kinds.at(expected_.size() % kinds.size());
}

// A driver that leaves early has asked for nothing wrong then.
bool ReplayChannel::by_lookup() const {
  return driver_does_ != Driver::leaves_early && steps_.size() % 3 == 0;
}

// A request is the run of writes between two answers (libport/replay/README.md).
bool ReplayChannel::one_request_begins_another() const {
  std::vector<Bytes> requests(1);
  for (const Step& step : steps_) {
    if (step.reads) {
      requests.emplace_back();
    } else {
      requests.back().insert(requests.back().end(), step.data.begin(), step.data.end());
    }
  }
  std::erase_if(requests, [](const Bytes& request) { return request.empty(); });
  return std::ranges::any_of(requests, [&requests](const Bytes& one) {
    return std::ranges::any_of(requests, [&one](const Bytes& other) {
      return one.size() < other.size() && std::equal(one.begin(), one.end(), other.begin());
    });
  });
}

void ReplayChannel::make_tape() {
  Result<TapeWriter> tape = TapeWriter::create(literal_tape((world().folder() / (name() + ".log")).string()),
                                               {.device = "simulated", .driver = "simulated"}, {});
  if (!tape) return world().wrong("{}", tape.error().message);
  TapeTime at{};
  tape->event(at, event::Open{});
  for (auto count = world().between(1, 12); count > 0; --count) {
    at += std::chrono::duration_cast<Micros>(world().some_time(milliseconds(300)));
    Step step{world().chance(0.5),
              world().some_bytes(static_cast<std::size_t>(world().between(1, 1 << world().between(0, 12))))};
    if (world().chance(0.2)) {
      step.baud = 300 * static_cast<unsigned>(world().between(1, 4));
      tape->event(at, event::Settings{Side::driver, {.baud = step.baud}, SettingsOrder::sampled});
    }
    tape->block(step.reads ? Direction::read : Direction::write, at, step.data);
    world().trace("{}: the tape has at {} us {} {} bytes", name(), to_us(at), step.reads ? "read" : "written",
                  step.data.size());
    if (step.reads) {
      answers_.insert(expected_.size());
      expected_.insert(expected_.end(), step.data.begin(), step.data.end());
    }
    steps_.push_back(std::move(step));
  }
  tape->event(at + Micros(1000), event::Close{});
  if (const Result<void> done = tape->finish(at + Micros(1000)); !done)
    world().wrong("{}", done.error().message);
  pause_decides_ = by_lookup() && one_request_begins_another();
  leaves_at_ = static_cast<std::size_t>(world().between(0, static_cast<std::int64_t>(steps_.size()) - 1));
  if (driver_does_ == Driver::one_byte_wrong) {
    const auto wrong = std::ranges::find(steps_, false, &Step::reads);
    if (wrong == steps_.end()) {
      driver_does_ = Driver::as_recorded;
    } else {
      wrong->data[static_cast<std::size_t>(
          world().between(0, static_cast<std::int64_t>(wrong->data.size()) - 1))] ^= Byte{1};
    }
  }
  if (driver_does_ == Driver::leaves_early &&
      std::none_of(steps_.begin() + static_cast<std::ptrdiff_t>(leaves_at_), steps_.end(),
                   [](const Step& step) { return !step.reads; })) {
    driver_does_ = Driver::as_recorded;  // it leaves out nothing that is checked
  }
}

void ReplayChannel::start() {
  world().after(world().some_time(milliseconds(500)), [this] {
    driver_.open();
    act();
  });
}

// Later, and once.
void ReplayChannel::act() {
  if (std::exchange(acting_, true)) return;
  world().after(world().some_time(milliseconds(20)), [this] {
    acting_ = false;
    write_on();
  });
}

void ReplayChannel::write_on() {
  driver_.read(world().chance(0.2) ? 1 : 1 << 20);
  if (driver_.unread() > 0) act();
  if (!driver_.is_open()) return;
  if (!to_write_.empty()) {
    const std::size_t taken = driver_.send(ByteView(to_write_).first(
        std::min(to_write_.size(), static_cast<std::size_t>(world().between(1, 4096)))));
    to_write_.erase(to_write_.begin(), to_write_.begin() + static_cast<std::ptrdiff_t>(taken));
    written_ += taken;
    return act();
  }
  if (driver_does_ == Driver::leaves_early && step_ == leaves_at_) {
    left_ = true;
    return driver_.close();
  }
  if (step_ == steps_.size()) {
    if (read_ == expected_.size()) driver_.close();
    return;
  }
  const Step& step = steps_[step_];
  if (step.baud > 0 && !std::exchange(set_, true)) {
    driver_.set({.baud = step.baud});
    return act();
  }
  if (!step.reads) {
    to_write_ = step.data;
    next_step();
    return act();
  }
  std::size_t wanted = 0;
  for (std::size_t n = 0; n <= step_; ++n) wanted += steps_[n].reads ? steps_[n].data.size() : 0;
  if (read_ < wanted) return;  // on_readable calls again
  next_step();
  act();
}

void ReplayChannel::next_step() {
  ++step_;
  set_ = false;
}

// How much of the device's bytes may have come by now: none that follows a byte which is not written.
std::size_t ReplayChannel::released() const {
  std::uint64_t writes = 0;
  std::size_t reads = 0;
  for (const Step& step : steps_) {
    if (step.reads) {
      reads += step.data.size();
    } else if ((writes += step.data.size()) > written_) {
      break;
    }
  }
  return reads;
}

// What the tape has next.
bool ReplayChannel::is_in_order(ByteView data) const {
  return read_ + data.size() <= expected_.size() &&
         std::equal(data.begin(), data.end(), expected_.begin() + static_cast<std::ptrdiff_t>(read_));
}

// The tape's answers, each whole, in whatever order and however often.
bool ReplayChannel::is_of_whole_answers(ByteView data) {
  for (const Byte byte : data) {
    const bool between = std::ranges::any_of(
        places_, [this](std::size_t place) { return answers_.contains(place) || place == expected_.size(); });
    if (between) places_.insert(answers_.begin(), answers_.end());
    std::set<std::size_t> next;
    for (const std::size_t place : places_) {
      if (place < expected_.size() && expected_[place] == byte) next.insert(place + 1);
    }
    places_ = std::move(next);
  }
  return !places_.empty();
}

void ReplayChannel::take_in(ByteView data) {
  // A wrong byte may make a request of the tape out of what was none, so short as these are: its answer comes
  // then, where the tape is searched for requests. Only there. So does that of a request which begins another
  // one, when the driver pauses behind it.
  const bool any_order =
      pause_decides_ || (driver_does_ == Driver::one_byte_wrong && (resyncs() || by_lookup()));
  const bool same = any_order ? is_of_whole_answers(data) : is_in_order(data);
  read_ += data.size();
  if (!same) world().wrong("{}: the driver got what is not on the tape, before byte {}", name(), read_);
  if (driver_does_ == Driver::as_recorded && !pause_decides_ && read_ > released())
    world().wrong("{}: byte {} came before what it answers was written", name(), read_);
}

void ReplayChannel::calm() { act(); }

void ReplayChannel::check_calm() {
  if (driver_does_ != Driver::as_recorded || pause_decides_) return;
  if (step_ < steps_.size() || read_ < expected_.size())
    world().wrong("{}: the driver waits for a minute, at step {} of {}, {} of {} bytes read", name(), step_,
                  steps_.size(), read_, expected_.size());
}

void ReplayChannel::check_end(bool failed) {
  std::ifstream file(report());
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto verdict = [&text](std::string_view wanted) {
    return text.find("\"verdict\":\"" + std::string(wanted) + "\"") != std::string::npos;
  };
  // An end that is wanted at once waits no longer for a disk; what is given up for it is told.
  if (text.empty() && failed && has_logged("given up")) return;
  if (text.empty()) return world().wrong("{}: there is no report", name());
  bool all_written = to_write_.empty();
  for (std::size_t n = step_; n < steps_.size(); ++n) all_written = all_written && steps_[n].reads;
  const bool done = driver_does_ == Driver::as_recorded && !pause_decides_ && all_written &&
                    step_ == steps_.size() && read_ == expected_.size();
  if (verdict("pass") && ((!all_written && !by_lookup()) || driver_does_ != Driver::as_recorded))
    world().wrong("{}: the verdict is pass, and the driver did not do as recorded", name());
  // What came after an end that was wanted at once reached nobody, and is told.
  if (done && !has_logged("reached nobody") && driver_.bytes_in == written_ && !verdict("pass"))
    world().wrong("{}: the driver did as recorded: {}", name(), text);
  if (driver_does_ == Driver::leaves_early && left_ && !verdict("incomplete"))
    world().wrong("{}: the driver left early: {}", name(), text);
}

}  // namespace porttape::simulation
