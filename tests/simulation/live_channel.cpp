#include "tests/simulation/live_channel.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <map>
#include <span>
#include <sys/stat.h>
#include <utility>
#include <variant>

#include "libport/tape/judgement.hpp"
#include "libport/tape/tape_lock.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tests/simulation/catalog.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// Whether `part` is `whole` less some of its bytes.
bool is_subsequence(ByteView part, ByteView whole) {
  auto at = whole.begin();
  for (const Byte byte : part) {
    at = std::find(at, whole.end(), byte);
    if (at == whole.end()) return false;
    ++at;
  }
  return true;
}

Bytes joined(const std::vector<Line::Passed>& passed, bool to_listener) {
  Bytes all;
  for (const Line::Passed& each : passed) {
    if (each.to_listener == to_listener) all.insert(all.end(), each.data.begin(), each.data.end());
  }
  return all;
}

// Whether a gap is the disk's and not the line's.
bool is_of_disk(std::string_view why) {
  constexpr std::array reasons = {"No space left on device", "Input/output error", "the disk did not keep up",
                                  "the recorder was ended at once"};
  return std::ranges::find(reasons, why) != reasons.end();
}

// Runs of one direction made one.
std::vector<Line::Passed> in_runs(const std::vector<Line::Passed>& passed) {
  std::vector<Line::Passed> runs;
  for (const Line::Passed& each : passed) {
    if (each.data.empty()) continue;
    if (runs.empty() || runs.back().to_listener != each.to_listener) {
      runs.push_back(each);
    } else {
      runs.back().data.insert(runs.back().data.end(), each.data.begin(), each.data.end());
    }
  }
  return runs;
}

}  // namespace

LiveChannel::LiveChannel(World& world, std::string name, bool records, bool disk_fails)
    : Channel(world, std::move(name)),
      records_(records),
      disk_fails_(disk_fails),
      next_tape_(world.chance(0.5)),
      fail_closed_(next_tape_ && world.chance(0.3)),
      driver_acts_left_(1 << world.between(1, 8)),
      device_acts_left_(1 << world.between(1, 8)),
      pace_(world.some_time(seconds(5)) + milliseconds(1)),
      most_bytes_(static_cast<std::size_t>(world.between(1, 1 << world.between(1, 14)))),
      driver_(world, this->name() + "-driver", Line::Kind::of_driver(world)),
      device_(world, this->name() + "-device", Line::Kind::of_device(world)) {
  put_up(world, driver_);
  put_up(world, device_);
  driver_.on_readable = [this] { reads_soon(driver_, driver_stalls_, driver_reads_); };
  device_.on_readable = [this] { reads_soon(device_, device_stalls_, device_reads_); };
}

ChannelSpec LiveChannel::spec() const {
  ChannelSpec spec;
  spec.mode = records_ ? ChannelMode::record : ChannelMode::bridge;
  spec.values = {{"driver", "memory:" + driver_.name()}, {"device", "memory:" + device_.name()}};
  if (const std::string plan = faults(); !plan.empty()) {
    spec.values["faults"] = plan;
    spec.values["seed"] = std::to_string(most_bytes_);
  }
  if (!records_) return spec;
  spec.values["tape"] = (world().folder() / (name() + ".log")).string();
  if (next_tape_) spec.values["on-existing"] = "next";
  if (fail_closed_) spec.values["fail-closed"] = "1";
  return spec;
}

// Of some devices' lines, by what else is known of them. They lose bytes and change none.
std::string LiveChannel::faults() const {
  switch (most_bytes_ % 16) {
    case 3:
      return "drop:p=0.01;truncate:p=0.1:size=50;delay:p=0.01:for=0.2;stall:p=0.001:for=3";
    case 7:
      return "hangup:p=0.001;replug:p=0.0005:for=2:dir=r;hangup:at=7;replug:at=20:for=0.5;delay:p=0.01";
    default:
      return {};
  }
}

void LiveChannel::start() {
  if (world().chance(0.9)) device_.open();
  world().after(world().some_time(pace_), [this] { driver_acts(); });
  world().after(world().some_time(pace_), [this] { device_acts(); });
}

void LiveChannel::reads_soon(Line& line, bool& stalls, bool& planned) {
  if (stalls || std::exchange(planned, true)) return;
  world().after(world().some_time(milliseconds(50)), [this, &line, &stalls, &planned] {
    planned = false;
    if (stalls) return;
    const std::size_t most = world().chance(0.3) ? 1 : 1 << 20;
    line.read(calm_ ? line.unread() : most);
    // One that was sent the end of its input ends too.
    if (line.near_ended() && line.unread() == 0) {
      if (world().chance(0.5))
        (void)line.send(world().some_bytes(static_cast<std::size_t>(world().between(1, 100))));
      return line.close();
    }
    if (line.unread() > 0) reads_soon(line, stalls, planned);
  });
}

void LiveChannel::driver_acts() {
  if (calm_ || driver_acts_left_-- == 0) return;
  const auto act = world().between(0, 99);
  if (!driver_.is_open()) {
    driver_.open();
  } else if (act < 60) {
    (void)driver_.send(world().some_bytes(
        static_cast<std::size_t>(world().between(1, static_cast<std::int64_t>(most_bytes_)))));
  } else if (act < 68) {
    driver_stalls_ = !driver_stalls_;
    if (!driver_stalls_) reads_soon(driver_, driver_stalls_, driver_reads_);
  } else if (act < 74) {
    driver_.half_close();
  } else if (act < 78) {
    driver_.flush_input();
  } else if (act < 88) {
    driver_.close();
  } else if (act < 89 && records_ && !disk_fails_) {
    replace_tape();
  }
  world().after(world().some_time(pace_), [this] { driver_acts(); });
}

void LiveChannel::device_acts() {
  if (calm_ || device_acts_left_-- == 0) return;
  const auto act = world().between(0, 99);
  if (!device_.is_open()) {
    if (act < 50) device_.plug_in();
  } else if (act < 70) {
    (void)device_.send(world().some_bytes(
        static_cast<std::size_t>(world().between(1, static_cast<std::int64_t>(most_bytes_)))));
  } else if (act < 80) {
    device_stalls_ = !device_stalls_;
    if (!device_stalls_) reads_soon(device_, device_stalls_, device_reads_);
  } else if (act < 84) {
    device_.unplug();
  } else if (act < 86 && !device_.kind().always_open) {
    device_.close();
  } else if (act < 89 && !device_.kind().always_open) {
    device_.half_close();
  }
  world().after(world().some_time(pace_), [this] { device_acts(); });
}

// What another recorder would do that is to overwrite: a tape that is being written is not to be had.
void LiveChannel::replace_tape() {
  const std::string recording = name() + ": recording to ";
  const auto latest = std::find_if(world().logged().rbegin(), world().logged().rend(),
                                   [&](const std::string& line) { return line.starts_with(recording); });
  if (latest == world().logged().rend()) return;
  const std::string tape = latest->substr(recording.size());
  const bool ending = std::any_of(world().logged().rbegin(), latest, [&](const std::string& line) {
    return line.find(tape) != std::string::npos && line.find("complete") != std::string::npos;
  });
  if (ending || !is_being_written(literal_tape(tape).read)) return;  // complete, which is told later
  world().trace("{}: another recorder wants {}", name(), tape);
  const auto inode = [&tape] {
    struct stat file {};
    return ::stat(literal_tape(tape).read.c_str(), &file) == 0 ? file.st_ino : 0;
  };
  const ino_t before = inode();
  const Result<TapeWriter> taken =
      TapeWriter::create(literal_tape(tape), {}, {.on_existing = OnExisting::overwrite});
  if (taken || inode() != before)
    world().wrong("{}: {} was replaced while it was being written", name(), tape);
}

void LiveChannel::calm() {
  calm_ = true;
  driver_stalls_ = device_stalls_ = false;
  if (!device_.is_open()) device_.plug_in();
  reads_soon(driver_, driver_stalls_, driver_reads_);
  reads_soon(device_, device_stalls_, device_reads_);
}

void LiveChannel::check_calm() {
  if (driver_.is_open() && device_.is_open()) {
    if (driver_.unsent() > 0)
      world().wrong("{}: {} bytes of the driver are not read for a minute", name(), driver_.unsent());
    if (device_.unsent() > 0)
      world().wrong("{}: {} bytes of the device are not read for a minute", name(), device_.unsent());
  }
}

// What the log tells of bytes that reached nobody.
std::uint64_t LiveChannel::told() const { return told_by({"bytes reached nobody"}); }

// The numbers before one of these.
std::uint64_t LiveChannel::told_by(std::initializer_list<std::string_view> texts) const {
  std::uint64_t sum = 0;
  for (const std::string& line : world().logged()) {
    if (!line.starts_with(name() + ": ")) continue;
    for (const std::string_view text : texts) {
      const std::size_t end = line.find(text);
      if (end == std::string::npos || end == 0) continue;
      const std::size_t begin = line.find_last_not_of("0123456789", end - 2) + 1;
      std::uint64_t bytes = 0;
      std::from_chars(line.data() + begin, line.data() + end, bytes);
      sum += bytes;
    }
  }
  return sum;
}

void LiveChannel::check_end(bool failed) {
  check_line();
  if (records_) check_tape(failed);
}

void LiveChannel::check_line() {
  const auto passes = [this](const Line& from, const Line& to) {
    if (!is_subsequence(joined(to.passed, false), joined(from.passed, true)))
      world().wrong("{}: what {} was given is not what {} gave, in order", name(), to.name(), from.name());
  };
  passes(driver_, device_);
  passes(device_, driver_);
  if (!faults().empty()) return;  // whose losses are told nowhere
  const std::uint64_t lost = driver_.bytes_in - device_.bytes_out + device_.bytes_in - driver_.bytes_out +
                             driver_.bytes_dropped + device_.bytes_dropped + driver_.bytes_unread;
  if (lost != told()) world().wrong("{}: {} bytes reached nobody, told were {}", name(), lost, told());
  constexpr std::size_t kMostKept = 64 << 10;
  for (const Line* line : {&driver_, &device_}) {
    if (line->most_kept > kMostKept)
      world().wrong("{}: {} bytes were kept for {}, which did not take them", name(), line->most_kept,
                    line->name());
  }
}

// In the order in which they were begun, which is that of their names unless the first one took a free name.
std::vector<TapePaths> LiveChannel::tapes() const {
  const TapePaths first = literal_tape((world().folder() / (name() + ".log")).string());
  std::multimap<std::uint64_t, TapePaths> found;
  for (unsigned number = 1; number < 100; ++number) {
    const TapePaths paths = number == 1 ? first : numbered_tape(first, number);
    if (!std::filesystem::exists(paths.events)) continue;
    const Result<TapeSummary> summary = summarize(paths);
    if (!summary || !summary->events.header || !summary->events.header->zero) {
      world().wrong("{} is no tape", paths.name());
    } else {
      found.emplace(summary->events.header->zero->monotonic_us, paths);
    }
  }
  std::vector<TapePaths> tapes;
  for (const auto& [zero, paths] : found) {
    const bool in_order = tapes.empty() || tapes.back().name().size() < paths.name().size() ||
                          tapes.back().name() < paths.name();
    if (!in_order && !next_tape_)
      world().wrong("{}: {} was begun before {}", name(), tapes.back().name(), paths.name());
    tapes.push_back(paths);
  }
  return tapes;
}

void LiveChannel::check_tape(bool failed) {
  std::vector<Line::Passed> taped;
  std::uint64_t gaps = 0;  // of the line, too
  std::uint64_t disk_gaps = 0;
  for (const TapePaths& paths : tapes()) {
    Result<TapeReader> reader = TapeReader::open(paths);
    if (!reader) return world().wrong("{}: {}", name(), reader.error().message);
    TapeTime last{};
    for (;;) {
      const Result<std::optional<Record>> next = reader->next();
      if (!next) return world().wrong("{}: {}", paths.name(), next.error().message);
      if (!*next) break;
      const Record& record = **next;
      if (record.at < last) world().wrong("{}: time goes back at {}", paths.name(), to_us(record.at));
      last = record.at;
      if (record.kind == RecordKind::read || record.kind == RecordKind::write)
        taped.push_back({record.kind == RecordKind::read, Bytes(record.data.begin(), record.data.end())});
      const auto* gap = record.event == nullptr ? nullptr : std::get_if<event::Gap>(record.event);
      if (gap != nullptr) gaps += gap->bytes;
      if (gap != nullptr && is_of_disk(gap->why)) disk_gaps += gap->bytes;
    }
    const Result<TapeSummary> summary = summarize(paths);
    if (!summary) return world().wrong("{}: {}", name(), summary.error().message);
    const Judgement judgement = judge(*summary);
    if (!disk_fails_ && judgement.verdict == Judgement::Verdict::damaged)
      world().wrong("{} is damaged: {}", paths.name(), judgement.damages.front());
    if (!disk_fails_ && !summary->events.ended) world().wrong("{} has no end", paths.name());
  }
  if (!faults().empty()) return;  // it is the line as they made it, not the device's
  const std::uint64_t of_line = driver_.bytes_in - device_.bytes_out + driver_.bytes_dropped +
                                device_.bytes_dropped + driver_.bytes_unread;
  std::uint64_t on_tape = 0;
  for (const Line::Passed& each : taped) on_tape += each.data.size();
  const std::uint64_t missing = device_.bytes_in + device_.bytes_out - on_tape;
  if (missing == 0) {
    const auto tape_runs = in_runs(taped);
    const auto line_runs = in_runs(device_.passed);
    const bool same = std::ranges::equal(tape_runs, line_runs, [](const auto& one, const auto& other) {
      return one.to_listener == other.to_listener && one.data == other.data;
    });
    if (!same) world().wrong("{}: the tape is not the line", name());
  }
  if (!disk_fails_ && missing != 0) world().wrong("{}: {} bytes are not on the tape", name(), missing);
  if (!disk_fails_ && gaps != of_line)
    world().wrong("{}: {} bytes of the line reached nobody, the tape's gaps tell {}", name(), of_line, gaps);
  // Each is told somewhere: by a gap, or where no gap could be written in the log.
  const std::uint64_t logged = told_by({"bytes passed and are on no tape", "bytes and "});
  if (disk_gaps + logged < missing)
    world().wrong("{}: {} bytes are not on the tape, its gaps tell {}, the log {}", name(), missing,
                  disk_gaps, logged);
  if (missing != 0 && !has_logged("trying again") && !failed)
    world().wrong("{}: {} bytes are not on the tape, and the daemon ended with 0", name(), missing);
  for (const bool reads : {true, false}) {
    if (!is_subsequence(joined(taped, reads), joined(device_.passed, reads)))
      world().wrong("{}: the tape has bytes that did not pass, or not in their order", name());
  }
}

}  // namespace porttape::simulation
