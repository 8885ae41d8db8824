#include "tests/simulation/replay_channel.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <utility>

#include <boost/json/array.hpp>
#include <boost/json/parse.hpp>

#include "tests/simulation/catalog.hpp"
#include "tests/simulation/replay_report_check.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Kind = TapeItem::Kind;
using Wrong = Mistake::Kind;

constexpr Nanos kStepTime = milliseconds(50);  // "at once"
constexpr Nanos kPatience = seconds(3);        // of a driver that did something wrong

std::string file_text(const std::string& name) {
  std::ifstream file(name);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A driver that hurries is never held up by its own line.
Line::Kind line_kind(World& world, bool hurries) {
  Line::Kind kind = Line::Kind::of_driver(world);
  if (hurries) kind.capacity = 1 << 17;
  return kind;
}

}  // namespace

ReplayChannel::ReplayChannel(World& world, std::string name, bool stalls)
    : Channel(world, std::move(name)),
      hurries_(world.chance(0.5)),
      driver_(world, this->name() + "-driver", line_kind(world, hurries_)),
      plan_(world, {.stalls = stalls, .hurries = hurries_, .half_closes = driver_.kind().half_closes}),
      check_(world, this->name(), plan_),
      controls_left_(plan_.controls()) {
  put_up(world, driver_);
  plan_.script().write_tape(world, tape(), this->name());
  if (plan_.is_ruled()) std::ofstream(rules()) << plan_.rules();
  world.trace("{}: {}", this->name(), plan_.to_text());
  if (!plan_.as_recorded())
    world.trace("{}: the driver will do {}, at item {}, byte {}", this->name(), name_of(plan_.mistake().kind),
                plan_.mistake().item, plan_.mistake().offset);
  std::ranges::transform(tape_files(), tape_before_.begin(), file_text);
  driver_.on_readable = [this] { arrived(); };
  driver_.on_broken = [this] {
    broken_ = true;
    check_.hung_up();
    act();
  };
}

ChannelSpec ReplayChannel::spec() const {
  OptionValues values = plan_.options();
  values.insert({{"driver", "memory:" + driver_.name()}, {"tape", tape()}, {"report", report().string()}});
  if (plan_.is_ruled()) values.insert({"rules", rules()});
  return {ChannelMode::replay, std::move(values)};
}

std::array<std::string, 3> ReplayChannel::tape_files() const {
  return {tape() + 'r', tape() + 'w', tape() + 'e'};
}

void ReplayChannel::start() {
  world().after(world().some_time(milliseconds(500)), [this] { act(); });
  if (controls_left_ > 0) world().after(world().some_time(seconds(2)), [this] { control(); });
}

// Later, and once.
void ReplayChannel::act() {
  if (acting_) return;
  const Nanos when = plan_.is_punctual() ? Nanos(0) : world().some_time(milliseconds(20));
  act_at(world().loop().now() + when);
}

void ReplayChannel::act_at(Instant when) {
  if (std::exchange(acting_, true)) return;
  world().after(when - world().loop().now(), [this] {
    acting_ = false;
    go_on();
  });
}

void ReplayChannel::next_item() {
  ++item_;
  not_before_.reset();
  act();
}

void ReplayChannel::ends() {
  finished_ = true;
  if (driver_.is_open()) driver_.close();
}

// Bytes were given to the driver's line, or it ended.
void ReplayChannel::arrived() {
  const Passed& last = driver_.passed.back();
  const bool is_data = !last.to_listener && last.what == Passed::What::data;
  if (is_data && check_.delivered() < driver_.bytes_out) {
    check_.came(Bytes(last.data));
    if (hurries_) driver_.read(1 << 20);
  }
  act();
}

void ReplayChannel::go_on() {
  if (finished_) return;
  driver_.read(hurries_ || !world().chance(0.2) ? 1 << 20 : 1);
  if (driver_.unread() > 0) act();
  if (item_ == plan_.script().items().size()) return ends();
  const TapeItem& item = plan_.script().items()[item_];
  if (broken_ && item.kind != Kind::open && item.kind != Kind::close && !goes_on_without_line(item)) return;
  if (!driver_.is_open() && item.kind == Kind::write) return;  // told at the end
  do_item(item);
}

// On a line that broke before its session's end.
bool ReplayChannel::goes_on_without_line(const TapeItem& item) {
  if (!plan_.as_recorded()) {
    ends();
    return false;
  }
  if (item.kind == Kind::hang_up || item.kind == Kind::device_ends) {
    next_item();
    return false;
  }
  missed_settings_ = missed_settings_ || item.kind == Kind::settings;
  // If nothing on the tape has ended the line, that is told at the end.
  return item.is_note() || item.kind == Kind::flush || item.kind == Kind::settings ||
         !plan_.goes_on_at_end() || calm_;
}

void ReplayChannel::do_item(const TapeItem& item) {
  switch (item.kind) {
    case Kind::open:
      return open();
    case Kind::close:
      return close();
    case Kind::read:
      if (!has_read(item_ + 1) && !need_not_wait() && waits()) return;
      break;
    case Kind::write:
      if (!write_on()) return;
      break;
    case Kind::settings: {
      const bool wrong = plan_.mistake().kind == Wrong::settings && item_ == plan_.mistake().item;
      made_mistake_ = made_mistake_ || wrong;
      missed_settings_ = missed_settings_ || may_have_ended();
      driver_.set({.baud = wrong ? 77 : item.baud});
      break;
    }
    case Kind::driver_ends:
      driver_.half_close();
      check_.did(item_);
      break;
    case Kind::flush:
      flush();
      break;
    case Kind::device_ends:
      if (driver_.kind().half_closes && !driver_.near_ended() && !broken_ && waits()) return;
      break;
    case Kind::hang_up:
      looks_for_hang_up_ = !broken_ && waits();
      if (looks_for_hang_up_) return act_at(world().loop().now() + look_for_hang_up());
      break;
    case Kind::mark:
    case Kind::gap:
      break;
  }
  next_item();
}

// Most drivers look often; some do something else for so long that whoever waits for them might give up. Not
// drawn: each seed stays what it was.
Nanos ReplayChannel::look_for_hang_up() const {
  const bool seldom = plan_.script().items().size() % 4 == 0;
  return seldom ? Nanos(seconds(10)) : Nanos(milliseconds(100));
}

void ReplayChannel::open() {
  driver_.open();
  const Instant now = world().loop().now();
  if (!driver_.is_open()) return act_at(now + milliseconds(5));  // the last one's close is not seen yet
  broken_ = false;
  unseen_until_.reset();
  if (item_ == 0) opened_ = now;
  check_.opened(item_);
  next_item();
}

void ReplayChannel::close() {
  // A line that is closed before the near end has seen it open forgets what was sent.
  if (is_unseen()) return;
  if (!broken_ && !has_read(item_) && waits()) return;
  if (!broken_ && is_last_item() && !plan_.goes_on_at_end() && plan_.as_recorded())
    return;  // the line is to end by itself
  if (plan_.mistake().kind == Wrong::trailing && !made_mistake_ && driver_.is_open() && is_last_item()) {
    check_.wrote(driver_.send(Bytes{kExtraByte}));
    made_mistake_ = check_.written() > plan_.script().writes().size();
    return act();
  }
  if (made_mistake_) check_.gave_up();
  driver_.close();
  const bool is_last = is_last_item();
  next_item();
  if (is_last) ends();
}

// Only what the driver has not read may be dropped: nothing may be under way that has to come.
void ReplayChannel::flush() {
  if (!plan_.is_gated() && plan_.has_pieces()) return;  // what is due may be held back
  const auto next =
      std::ranges::find_if(plan_.answers(), [this](const Answer& each) { return each.item > item_; });
  const bool is_next_asked = next != plan_.answers().end() && next->gate < item_;
  if (driver_.unread() > 0 && check_.has_come(item_) && !is_next_asked) driver_.flush(FlushQueue::in);
}

// All of the tape has passed, and with it maybe the line, which the driver does not know yet.
bool ReplayChannel::may_have_ended() const {
  return !plan_.goes_on_at_end() && check_.delivered() == plan_.script().reads().size() &&
         check_.written() == plan_.script().writes().size();
}

// By lookup "what stands before a session's first write comes by the clock of the driver's open": its place
// among the answers is the driver's affair.
bool ReplayChannel::need_not_wait() const {
  const auto read = std::ranges::find(plan_.answers(), item_, &Answer::item);
  const bool unasked = plan_.script().items()[read->gate].kind == Kind::open;
  return plan_.writes_ahead() && !(plan_.looks_up() && unasked);
}

bool ReplayChannel::has_read(std::size_t items) const {
  return check_.has_come(items) && driver_.unread() == 0;
}

// For something that is to come. For a driver that did something wrong it may never do.
bool ReplayChannel::waits() {
  if (plan_.as_recorded() || !made_mistake_) return true;
  const Instant now = world().loop().now();
  if (!not_before_) not_before_ = now + kPatience;
  if (now >= *not_before_) {
    check_.gave_up();
    return false;
  }
  world().after(kPatience, [this] { act(); });
  return true;
}

// Waits for the near end to see that the line is open. It never does once the channel has ended.
bool ReplayChannel::is_unseen() {
  if (!driver_.is_open() || driver_.is_up()) return false;
  const Instant now = world().loop().now();
  if (!unseen_until_) unseen_until_ = now + kPatience;
  if (now >= *unseen_until_) {
    finished_ = true;
  } else {
    act_at(now + milliseconds(1));
  }
  return true;
}

// By the recorded clock, or the recorded time after what was before it.
Instant ReplayChannel::write_time() const {
  std::size_t before = item_ - 1;
  while (before > 0 && plan_.script().items()[before].kind == Kind::close) --before;
  const bool gated = plan_.is_gated();
  const double gap = nanos(plan_.time_of(item_) - (gated ? plan_.time_of(before) : Micros(0))) / plan_.rate();
  const std::int64_t margin = plan_.jitter().count() / 2;
  const Nanos error = plan_.mistake().kind == Wrong::time && item_ == plan_.mistake().item
                          ? plan_.mistake().time
                          : Nanos(world().between(gated ? -margin : 0, margin));
  return (gated ? check_.last_event() : opened_) + Nanos(static_cast<std::int64_t>(gap)) + error;
}

// False: not yet, or not at all.
bool ReplayChannel::begin_write() {
  const Mistake& mistake = plan_.mistake();
  const bool wrong = item_ == mistake.item && !plan_.as_recorded();
  if (plan_.is_punctual()) {
    if (!not_before_) not_before_ = write_time();
    if (world().loop().now() < *not_before_) {
      act_at(*not_before_);
      return false;
    }
  }
  if (wrong && mistake.kind == Wrong::early) {
    made_mistake_ = true;
    ends();
    return false;
  }
  in_write_ = true;
  to_write_ = plan_.written(item_);
  if (wrong && mistake.kind != Wrong::trailing) to_write_ = plan_.mistaken(std::move(to_write_));
  made_mistake_ = made_mistake_ || (wrong && mistake.kind != Wrong::trailing);
  return true;
}

// True: all of it is written.
bool ReplayChannel::write_on() {
  if (!in_write_ && !begin_write()) return false;
  const std::size_t most = hurries_ ? to_write_.size() : static_cast<std::size_t>(world().between(1, 4096));
  const std::size_t taken = driver_.send(ByteView(to_write_).first(std::min(to_write_.size(), most)));
  to_write_.erase(to_write_.begin(), to_write_.begin() + static_cast<std::ptrdiff_t>(taken));
  check_.wrote(taken);
  if (!to_write_.empty()) {
    if (is_unseen()) return false;
    plan_.is_punctual() ? act_at(world().loop().now() + milliseconds(1)) : act();
    return false;
  }
  in_write_ = false;
  check_.did(item_);
  return true;
}

bool ReplayChannel::ask(const std::string& request) {
  if (!world().control) return false;
  const std::string reply = world().control(request);
  world().trace("{}: control: {} -> {}", name(), request, reply);
  return reply.find("\"ok\":true") != std::string::npos;
}

void ReplayChannel::control() {
  if (calm_ || controls_left_-- == 0) return;
  if (!check_.clock().paused()) {
    world().chance(0.6) ? ask_pause(true) : ask_rate();
  } else if (world().chance(0.5)) {
    ask_step();
  } else {
    ask_pause(false);
  }
  if (world().chance(0.3)) look_at_status();
  world().after(world().some_time(seconds(2)), [this] { control(); });
}

void ReplayChannel::ask_pause(bool on) {
  if (!on) check_.going_on();
  if (ask(fmt::format(R"({{"verb":"{}","channel":"{}"}})", on ? "pause" : "resume", name())))
    check_.paused(on);
}

void ReplayChannel::ask_rate() {
  const double rate = static_cast<double>(world().between(1, 80)) / 8;
  if (ask(fmt::format(R"({{"verb":"rate","rate":"{}","channel":"{}"}})", rate, name())))
    check_.has_rate(rate);
}

void ReplayChannel::ask_step() {
  const auto count = static_cast<std::uint64_t>(world().chance(0.7) ? 1 : world().between(2, 4));
  check_.steps(count);
  if (!ask(fmt::format(R"({{"verb":"step","count":"{}","channel":"{}"}})", count, name())))
    return check_.refused_steps(count);
  world().after(kStepTime, [this, pause = check_.pause()] {
    const bool is_same = pause == check_.pause() && check_.clock().paused();
    if (is_same && !broken_ && driver_.is_open() && driver_.unsent() == 0) check_.check_steps(item_);
  });
}

void ReplayChannel::look_at_status() {
  if (!world().control) return;
  boost::system::error_code error;
  const boost::json::value reply = boost::json::parse(world().control(R"({"verb":"status"})"), error);
  if (error) return world().wrong("{}: the status is no JSON", name());
  for (const boost::json::value& channel : reply.at("status").at("channels").as_array()) {
    if (channel.at("name").as_string() != name()) continue;
    for (const boost::json::value& line : channel.at("lines").as_array()) {
      const auto* playback = line.as_object().if_contains("playback");
      if (playback == nullptr) continue;
      if (playback->at("paused").as_bool() != check_.clock().paused())
        world().wrong("{}: the status tells wrongly whether it is paused", name());
      const auto rate = playback->at("rate").to_number<double>();
      if (rate != check_.clock().rate()) world().wrong("{}: the status tells a rate of {}", name(), rate);
    }
  }
}

void ReplayChannel::calm() {
  calm_ = true;
  if (check_.clock().paused()) ask_pause(false);
  act();
}

void ReplayChannel::check_calm() {
  if (driver_.is_up() && driver_.unsent() > 0)
    world().wrong("{}: {} bytes of the driver are not read for a minute", name(), driver_.unsent());
  // By the recorded clock the tape's end may come before the driver has written.
  const bool cut_short = (broken_ && !plan_.is_gated()) || check_.gates_are_lenient();
  if (!plan_.as_recorded() || plan_.pauses_decide() || cut_short) return;
  const std::size_t reads = plan_.script().reads().size();
  if (!finished_ || check_.delivered() < reads)
    world().wrong("{}: the driver waits for a minute, at item {} of {}, {} of {} bytes came", name(), item_,
                  plan_.script().items().size(), check_.delivered(), reads);
}

void ReplayChannel::check_end(bool failed) {
  for (std::size_t n = 0; n < tape_before_.size(); ++n) {
    if (file_text(tape_files()[n]) != tape_before_[n])
      world().wrong("{}: the replay has changed {}", name(), tape_files()[n]);
  }
  const ReportFile file(report());
  // What a disk does not take in time is given up, and told. Then the channel may have been started again,
  // and the report, if any, is of that.
  const bool given_up = has_logged("given up") || has_logged("was not written in time");
  if (failed && given_up) return;
  if (!file.is_there()) return world().wrong("{}: there is no report", name());
  check_report(world(), name(), plan_, file,
               {.failed = failed,
                .finished = finished_,
                .lost_bytes = has_logged("reached nobody"),
                .made_mistake = made_mistake_,
                .half_close_may_be_missed = check_.half_close_may_be_missed(),
                .missed_settings = missed_settings_ || driver_.ended_before_settings(),
                .item = item_,
                .written = check_.written(),
                .bytes_in = driver_.bytes_in,
                .bytes_out = driver_.bytes_out,
                .steps = check_.steps_asked()});
}

}  // namespace porttape::simulation
