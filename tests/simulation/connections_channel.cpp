#include "tests/simulation/connections_channel.hpp"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "libport/tape/judgement.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tests/simulation/catalog.hpp"
#include "tests/simulation/line_check.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

Line::Kind connected_driver_kind(World& world) {
  Line::Kind kind = Line::Kind::of_driver(world);
  kind.passive = false;  // of a connection
  kind.half_closes = true;
  return kind;
}

Line::Kind connected_device_kind(World& world) {
  Line::Kind kind = Line::Kind::of_device(world);
  kind.always_open = false;
  kind.knows_unread = world.chance(0.6);
  return kind;
}

// Whether its port is open: a session that has ended reads nothing any more.
bool is_served(const Line& line) {
  const auto last = std::find_if(line.passed.rbegin(), line.passed.rend(), [](const Passed& each) {
    return each.what == Passed::What::open || each.what == Passed::What::close;
  });
  return last != line.passed.rend() && last->what == Passed::What::open;
}

}  // namespace

ConnectionsChannel::Pair::Pair(World& world, const std::string& name)
    : driver(world, name + "-driver", connected_driver_kind(world)),
      device(world, name + "-device", connected_device_kind(world)) {}

ConnectionsChannel::ConnectionsChannel(World& world, std::string name, bool records, bool disk_fails)
    : Channel(world, std::move(name)),
      records_(records),
      disk_fails_(disk_fails),
      pace_(world.some_time(seconds(2)) + milliseconds(1)),
      most_bytes_(world.between(1, 1 << world.between(1, 13))),
      to_come_(world.between(1, 8)),
      hall_(world, this->name() + "-hall", [this]() -> Line& { return next_device(); }) {
  put_up(world, hall_);
}

ChannelSpec ConnectionsChannel::spec() const {
  ChannelSpec spec;
  spec.mode = records_ ? ChannelMode::record : ChannelMode::bridge;
  spec.values = {{"driver", "memory:" + hall_.name() + ",listen"},
                 {"device", "memory:" + hall_.name()},
                 {"connections", "each"}};
  if (records_) spec.values["tape"] = (world().folder() / (name() + ".log")).string();
  return spec;
}

void ConnectionsChannel::start() {
  world().after(world().some_time(pace_), [this] { connect(); });
}

void ConnectionsChannel::connect() {
  if (calm_ || to_come_-- == 0) return;
  Pair& pair = pairs_.emplace_back(world(), fmt::format("{}-{}", name(), pairs_.size() + 1));
  for (End* end : {&pair.driver, &pair.device}) {
    end->acts_left = 1 << world().between(1, 6);
    end->line.on_readable = [this, end] { reads_soon(*end); };
  }
  if (world().chance(0.9)) pair.device.line.plug_in();
  connecting_ = true;
  if (hall_.connect(pair.driver.line)) pair.number = ++came_;
  connecting_ = false;
  if (pair.number != 0) {
    for (End* end : {&pair.driver, &pair.device})
      world().after(world().some_time(pace_), [this, end] { acts(*end); });
  }
  world().after(world().some_time(pace_), [this] { connect(); });
}

// Before the first connection the daemon tries out how a device's port is made.
Line& ConnectionsChannel::next_device() {
  if (connecting_) return pairs_.back().device.line;
  return probes_.emplace_back(world(), name() + "-probe", connected_device_kind(world()));
}

void ConnectionsChannel::acts(End& end) {
  if (calm_ || end.acts_left-- == 0) return;
  Line& line = end.line;
  const auto act = world().between(0, 99);
  if (!line.is_open()) return;
  if (act < 75) {
    (void)line.send(world().some_bytes(static_cast<std::size_t>(world().between(1, most_bytes_))));
  } else if (act < 85) {
    end.stalls = !end.stalls;
    if (!end.stalls) reads_soon(end);
  } else if (act < 90) {
    line.half_close();
  } else if (act < 95) {
    line.close();
  } else if (act < 96) {
    line.lose(false);
  }
  world().after(world().some_time(pace_), [this, &end] { acts(end); });
}

void ConnectionsChannel::reads_soon(End& end) {
  if (end.stalls || std::exchange(end.reads, true)) return;
  world().after(world().some_time(milliseconds(50)), [this, &end] {
    end.reads = false;
    if (end.stalls) return;
    Line& line = end.line;
    line.read(!calm_ && world().chance(0.3) ? 1 : line.unread());
    if (line.near_ended() && line.unread() == 0) return line.close();
    if (line.unread() > 0) reads_soon(end);
  });
}

void ConnectionsChannel::calm() {
  calm_ = true;
  for (Pair& pair : pairs_) {
    for (End* end : {&pair.driver, &pair.device}) {
      end->stalls = false;
      reads_soon(*end);
    }
  }
}

void ConnectionsChannel::check_calm() {
  for (const Pair& pair : pairs_) {
    if (pair.number == 0 || !pair.driver.line.is_open() || !pair.device.line.is_open()) continue;
    if (!is_served(pair.device.line)) continue;
    for (const Line* line : {&pair.driver.line, &pair.device.line}) {
      if (line->unsent() > 0)
        world().wrong("{}: {} bytes are not read for a minute", line->name(), line->unsent());
    }
  }
}

void ConnectionsChannel::check_end(bool) {
  for (const Pair& pair : pairs_) {
    if (pair.number == 0) continue;
    check(pair);
    if (records_ && !disk_fails_) check_tapes(pair);
  }
}

void ConnectionsChannel::check(const Pair& pair) {
  const Line& driver = pair.driver.line;
  const Line& device = pair.device.line;
  check_passes(world(), driver, device);
  check_passes(world(), device, driver);
  const std::uint64_t lost = lost_between(driver, device);
  // Its own log has it.
  const std::uint64_t told =
      told_by(world(), fmt::format("{} c{}", name(), pair.number), {"bytes reached nobody"});
  if (lost != told) world().wrong("{}: {} bytes reached nobody, told were {}", driver.name(), lost, told);
}

// Its parts together are what passed at the device, each way.
void ConnectionsChannel::check_tapes(const Pair& pair) {
  const TapePaths first = literal_tape((world().folder() / (name() + ".log")).string());
  Bytes read;
  Bytes written;
  for (unsigned part = 1; part < 100; ++part) {
    const TapePaths paths = connection_tape(part == 1 ? first : numbered_tape(first, part), pair.number);
    if (!std::filesystem::exists(paths.events)) continue;
    const Result<TapeSummary> summary = summarize(paths);
    if (!summary) return world().wrong("{}", summary.error().message);
    const Judgement judgement = judge(*summary);
    if (judgement.verdict == Judgement::Verdict::damaged)
      world().wrong("{} is damaged: {}", paths.name(), judgement.damages.front());
    if (!summary->events.ended) world().wrong("{} has no end", paths.name());
    Result<TapeReader> reader = TapeReader::open(paths);
    if (!reader) return world().wrong("{}", reader.error().message);
    for (;;) {
      const auto next = reader->next();
      if (!next) return world().wrong("{}", next.error().message);
      if (!*next) break;
      const Record& record = **next;
      if (record.kind != RecordKind::read && record.kind != RecordKind::write) continue;
      Bytes& all = record.kind == RecordKind::read ? read : written;
      all.insert(all.end(), record.data.begin(), record.data.end());
    }
  }
  const Line& device = pair.device.line;
  if (read != joined(device.passed, true))
    world().wrong("{}: the tape has other bytes from it", device.name());
  if (written != joined(device.passed, false))
    world().wrong("{}: the tape has other bytes to it", device.name());
}

}  // namespace porttape::simulation
