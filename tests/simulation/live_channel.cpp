#include "tests/simulation/live_channel.hpp"

#include <algorithm>
#include <array>
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
#include "tests/simulation/acts_check.hpp"
#include "tests/simulation/catalog.hpp"
#include "tests/simulation/line_check.hpp"
#include "tests/simulation/tape_steps.hpp"

namespace porttape::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// On the driver's own port.
constexpr std::string_view kDriverFaults =
    "drop:p=0.005;delay:p=0.01:for=0.1;stall:p=0.0005:for=2;hangup:p=0.0003,seed=11";

// A device that is kept open may send before a driver has come: there is no tape yet.
std::vector<Passed> since_opens(std::span<const Passed> passed) {
  std::vector<Passed> recorded;
  bool begun = false;
  for (const Passed& each : passed) {
    begun = (begun || each.what == Passed::What::open) && each.what != Passed::What::prepare &&
            each.what != Passed::What::finish;
    if (begun && each.what == Passed::What::data) recorded.push_back(each);
  }
  return recorded;
}

// Whether a gap is the disk's and not the line's.
bool is_of_disk(std::string_view why) {
  constexpr std::array reasons = {"No space left on device", "Input/output error", "the disk did not keep up",
                                  "the recorder was ended at once"};
  return std::ranges::find(reasons, why) != reasons.end();
}

// Runs of one direction made one, but for datagrams.
std::vector<Passed> in_runs(std::span<const Passed> passed, bool datagrams) {
  std::vector<Passed> runs;
  for (const Passed& each : passed) {
    if (each.what != Passed::What::data || each.data.empty()) continue;
    if (datagrams || runs.empty() || runs.back().to_listener != each.to_listener) {
      runs.push_back(each);
    } else {
      runs.back().data.insert(runs.back().data.end(), each.data.begin(), each.data.end());
    }
  }
  return runs;
}

// A tty as often as a socket; half of the drivers on one run under a supervisor.
Line::Kind live_driver_kind(World& world) {
  Line::Kind kind = Line::Kind::of_driver(world);
  kind.datagrams = !kind.half_closes && world.chance(0.2);
  kind.supervised = !kind.half_closes && !kind.datagrams && world.chance(0.5);
  return kind;
}

Line::Kind live_device_kind(World& world) {
  Line::Kind kind = Line::Kind::of_device(world);
  kind.datagrams = !kind.half_closes && world.chance(0.2);
  kind.serial = !kind.half_closes && !kind.datagrams && world.chance(0.7);
  kind.knows_unread = world.chance(0.6);
  kind.passive = kind.half_closes && !kind.always_open && world.chance(0.3);
  return kind;
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
      device_is_slow_(world.chance(0.2)),
      driver_(world, this->name() + "-driver", live_driver_kind(world)),
      device_(world, this->name() + "-device", live_device_kind(world)) {
  put_up(world, driver_);
  put_up(world, device_);
  driver_.on_readable = [this] { reads_soon(driver_, driver_stalls_, driver_reads_); };
  device_.on_prepare = [this] { lost_at_prepare_ = lost_by_line(); };
  device_.on_open = [this] {
    if (const auto before = std::exchange(lost_at_prepare_, std::nullopt))
      lost_without_tape_ += lost_by_line() - *before;
  };
  device_.on_cut = [this](std::size_t bytes) { check_cut(bytes); };
  device_.on_readable = [this] { reads_soon(device_, device_stalls_, device_reads_); };
}

ChannelSpec LiveChannel::spec() const {
  ChannelSpec spec;
  spec.mode = records_ ? ChannelMode::record : ChannelMode::bridge;
  const std::string of_driver = faults_on_driver() ? ",faults=" + std::string(kDriverFaults) : "";
  spec.values = {{"driver", "memory:" + driver_.name() + of_driver},
                 {"device", "memory:" + device_.name() + (device_.kind().always_open ? ",alwaysopen" : "")}};
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
  if (world().chance(0.9)) device_.plug_in();
  world().after(world().some_time(pace_), [this] { driver_acts(); });
  world().after(world().some_time(pace_), [this] { device_acts(); });
}

void LiveChannel::reads_soon(Line& line, bool& stalls, bool& planned) {
  if (stalls || std::exchange(planned, true)) return;
  // An end waits for a device as long as that takes something (contract, "Signals"): it hurries at last.
  const bool hurries = !world().ends().empty() && world().loop().now() - world().ends().front() > seconds(30);
  const bool slow = &line == &device_ && device_is_slow_ && !calm_ && !hurries;
  const Nanos soon = slow ? milliseconds(world().between(50, 900)) : world().some_time(milliseconds(50));
  world().after(soon, [this, &line, &stalls, &planned, slow] {
    planned = false;
    if (stalls) return;
    const std::size_t most = slow ? line.unread() / 40 + 1 : world().chance(0.3) ? 1 : 1 << 20;
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
  if (driver_waits_) {
    if (act < 2) driver_.close();  // it was killed
  } else if (!driver_.is_open()) {
    driver_opens();
  } else if (act < 48) {
    (void)driver_.send(world().some_bytes(
        static_cast<std::size_t>(world().between(1, static_cast<std::int64_t>(most_bytes_)))));
  } else if (act < 55) {
    driver_stalls_ = !driver_stalls_;
    if (!driver_stalls_) reads_soon(driver_, driver_stalls_, driver_reads_);
  } else if (act < 60) {
    driver_.half_close();
  } else if (act < 64) {
    driver_.flush(static_cast<FlushQueue>(world().between(0, 2)));
  } else if (act < 82) {
    driver_does_to_line();
  } else if (act < 91) {
    driver_.close();
  } else if (act < 92) {
    driver_.lose(false);
  } else if (act < 93 && records_ && !disk_fails_) {
    replace_tape();
  }
  world().after(world().some_time(pace_), [this] { driver_acts(); });
}

// A supervised one begins as TtyCalls has it, and often makes its line ready at once.
void LiveChannel::driver_opens() {
  driver_waits_ = false;
  driver_.open();
  if (!driver_.kind().supervised) return;
  driver_.signal({LineSignal::Name::dtr, true});
  driver_.signal({LineSignal::Name::rts, true});
  if (!world().chance(0.5)) return;
  for (auto count = world().between(1, 5); count > 0 && !driver_waits_; --count) driver_does_to_line();
}

void LiveChannel::driver_does_to_line() {
  const auto waited_for = [this, session = ++driver_calls_] {
    if (session == driver_calls_) driver_waits_ = false;
  };
  switch (world().between(0, 5)) {
    case 0:
    case 1:
      return driver_sets();
    case 2:
    case 3: {
      constexpr std::array names = {LineSignal::Name::dtr, LineSignal::Name::rts, LineSignal::Name::brk};
      return driver_.signal({names.at(static_cast<std::size_t>(world().between(0, 2))), world().chance(0.5)});
    }
    case 4:
      driver_waits_ = world().chance(0.7);
      return driver_.drain(waited_for);
    default:
      driver_waits_ = world().chance(0.7);
      return driver_.ask({.kind = static_cast<LineRequest::Kind>(world().between(0, 4))},
                         [waited_for](const std::optional<LineAnswer>&) { waited_for(); });
  }
}

// Of a pty that is only looked at neither data bits nor parity are seen.
void LiveChannel::driver_sets() {
  LineSettings settings = driver_.settings();
  if (world().chance(0.7)) {
    settings.baud = 300 * static_cast<unsigned>(world().between(1, 400));
  } else {
    settings.hw_flow = !settings.hw_flow;
  }
  SeenSettings seen = SeenSettings::of(settings);
  if (!driver_.kind().supervised) {
    seen.data_bits.reset();
    seen.parity.reset();
  }
  driver_.set(seen);
}

void LiveChannel::device_acts() {
  if (calm_ || device_acts_left_-- == 0) return;
  const auto act = world().between(0, 99);
  if (!device_.is_open()) {
    if (act < 50) device_.plug_in();
  } else if (act < 62) {
    (void)device_.send(world().some_bytes(
        static_cast<std::size_t>(world().between(1, static_cast<std::int64_t>(most_bytes_)))));
  } else if (act < 70) {
    constexpr std::array names = {LineSignal::Name::cts, LineSignal::Name::dsr, LineSignal::Name::cd,
                                  LineSignal::Name::ri, LineSignal::Name::brk};
    device_.signal({names.at(static_cast<std::size_t>(world().between(0, 4))), world().chance(0.5)});
  } else if (act < 80) {
    device_stalls_ = !device_stalls_;
    if (!device_stalls_) reads_soon(device_, device_stalls_, device_reads_);
  } else if (act < 84) {
    device_.lose(world().chance(0.3));
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
  driver_stalls_ = device_stalls_ = driver_waits_ = false;
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

// The last bytes of a driver that has closed wait for the device, see README.md.
void LiveChannel::check_cut(std::size_t bytes) {
  constexpr Nanos kClosed = seconds(30);
  constexpr Nanos kNextWaits = seconds(1);
  constexpr Nanos kEnd = seconds(5);
  const Instant now = world().loop().now();
  const std::vector<Instant>& ends = world().ends();
  if (ends.size() > 1 || (fail_closed_ && disk_fails_)) return;
  if (has_faults()) return;  // a fault may have closed it
  if (ends.size() == 1 && now - ends.front() >= kEnd) return;
  const auto gone = std::find_if(driver_.passed.rbegin(), driver_.passed.rend(), [](const Passed& each) {
    return each.what == Passed::What::down || each.what == Passed::What::up;
  });
  const auto closed = std::find_if(driver_.passed.rbegin(), driver_.passed.rend(),
                                   [](const Passed& each) { return each.what == Passed::What::down; });
  if (closed == driver_.passed.rend())
    return world().wrong("{}: {} bytes for the device are given up, and the driver has not closed", name(),
                         bytes);
  if (now - closed->at >= kClosed) return;
  const bool next_waits = gone->what == Passed::What::up && now - gone->at >= kNextWaits;
  if (next_waits && now - std::max(device_.last_read, closed->at) >= kNextWaits) return;
  world().wrong("{}: {} bytes for the device are given up {} ms after the driver's close", name(), bytes,
                std::chrono::duration_cast<milliseconds>(now - closed->at).count());
}

void LiveChannel::check_end(bool failed) {
  check_line();
  const bool may_end = fail_closed_ && disk_fails_;
  const Instant end = may_end || world().ends().empty() ? Instant{} : world().ends().front();
  check_acts(world(), name(), driver_, device_, !has_faults(), end);
  if (records_) check_tape(failed);
}

void LiveChannel::check_line() {
  check_passes(world(), driver_, device_, !has_faults());
  check_passes(world(), device_, driver_, !has_faults());
  if (has_faults()) return;  // whose losses are told nowhere
  const std::uint64_t lost = lost_between(driver_, device_);
  const std::uint64_t told = told_by(world(), name(), {"bytes reached nobody"});
  if (lost != told) world().wrong("{}: {} bytes reached nobody, told were {}", name(), lost, told);
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

// Bytes that reached nobody, less those of the device that no driver took: those are on the tape.
std::uint64_t LiveChannel::lost_by_line() const {
  return driver_.bytes_in - device_.bytes_out + driver_.bytes_dropped + device_.bytes_dropped +
         driver_.bytes_unread;
}

void LiveChannel::check_tape(bool failed) {
  std::vector<Passed> taped;
  std::uint64_t gaps = 0;  // of the line, too
  std::uint64_t disk_gaps = 0;
  std::vector<TapeStep> steps;
  std::uint64_t read = 0;
  std::uint64_t written = 0;
  const std::vector<TapePaths> all = tapes();
  for (const TapePaths& paths : all) {
    Result<TapeReader> reader = TapeReader::open(paths);
    if (!reader) return world().wrong("{}: {}", name(), reader.error().message);
    TapeTime last{};
    bool carried = true;
    for (;;) {
      const Result<std::optional<Record>> next = reader->next();
      if (!next) return world().wrong("{}: {}", paths.name(), next.error().message);
      if (!*next) break;
      const Record& record = **next;
      if (record.at < last) world().wrong("{}: time goes back at {}", paths.name(), to_us(record.at));
      last = record.at;
      if (record.kind == RecordKind::read || record.kind == RecordKind::write)
        taped.push_back({record.kind == RecordKind::read, Bytes(record.data.begin(), record.data.end())});
      (record.kind == RecordKind::read ? read : written) += record.data.size();
      carried =
          carried && (record.event == nullptr ? record.data.empty()
                                              : std::holds_alternative<event::Open>(*record.event) ||
                                                    std::holds_alternative<event::Settings>(*record.event) ||
                                                    std::holds_alternative<event::Gap>(*record.event));
      if (const std::string what = record.event == nullptr ? "" : step_text(*record.event); !what.empty())
        steps.push_back({.what = what, .read = read, .written = written, .carried = carried});
      const auto* gap = record.event == nullptr ? nullptr : std::get_if<event::Gap>(record.event);
      if (gap != nullptr) gaps += gap->bytes;
      if (gap != nullptr && is_of_disk(gap->why.raw())) disk_gaps += gap->bytes;
    }
    const Result<TapeSummary> summary = summarize(paths);
    if (!summary) return world().wrong("{}: {}", name(), summary.error().message);
    const Judgement judgement = judge(*summary);
    if (!disk_fails_ && judgement.verdict == Judgement::Verdict::damaged)
      world().wrong("{} is damaged: {}", paths.name(), judgement.damages.front());
    if (!disk_fails_ && !summary->events.ended) world().wrong("{} has no end", paths.name());
  }
  if (has_faults()) return;  // it is the line as they made it, not the device's
  check_tape_steps(world(), name(), device_, steps, !disk_fails_);
  if (const auto before = std::exchange(lost_at_prepare_, std::nullopt))
    lost_without_tape_ += lost_by_line() - *before;
  const std::uint64_t of_line = lost_by_line() - lost_without_tape_;
  std::uint64_t on_tape = 0;
  for (const Passed& each : taped) on_tape += each.data.size();
  const std::vector<Passed> recorded = since_opens(device_.passed);
  std::uint64_t on_line = 0;
  for (const Passed& each : recorded) on_line += each.data.size();
  const std::uint64_t missing = on_line - on_tape;
  if (missing == 0) {
    const auto tape_runs = in_runs(taped, device_.kind().datagrams);
    const auto line_runs = in_runs(recorded, device_.kind().datagrams);
    const bool same = std::ranges::equal(tape_runs, line_runs, [](const auto& one, const auto& other) {
      return one.to_listener == other.to_listener && one.data == other.data;
    });
    if (!same) world().wrong("{}: the tape is not the line", name());
  }
  if (!disk_fails_ && missing != 0) world().wrong("{}: {} bytes are not on the tape", name(), missing);
  if (!disk_fails_ && gaps != of_line)
    world().wrong("{}: {} bytes of the line reached nobody, the tape's gaps tell {}", name(), of_line, gaps);
  // Each is told somewhere: by a gap, or where no gap could be written in the log.
  const std::uint64_t logged = told_by(world(), name(), {"bytes passed and are on no tape", "bytes and "});
  if (disk_gaps + logged < missing)
    world().wrong("{}: {} bytes are not on the tape, its gaps tell {}, the log {}", name(), missing,
                  disk_gaps, logged);
  if (missing != 0 && !has_logged("trying again") && !failed)
    world().wrong("{}: {} bytes are not on the tape, and the daemon ended with 0", name(), missing);
  for (const bool reads : {true, false}) {
    if (!is_subsequence(joined(taped, reads), joined(recorded, reads)))
      world().wrong("{}: the tape has bytes that did not pass, or not in their order", name());
  }
}

}  // namespace porttape::simulation
