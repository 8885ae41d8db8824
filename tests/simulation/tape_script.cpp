#include "tests/simulation/tape_script.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "libport/tape/tape_writer.hpp"

namespace porttape::simulation {

using Kind = TapeItem::Kind;

namespace {

constexpr std::array kStart{Byte{0xC3}, Byte{0xD4}, Byte{0xE5}};

}  // namespace

TapeScript::TapeScript(World& world, const Wanted& wanted) : longest_gap_(wanted.longest_gap) {
  for (auto count = world.between(1, wanted.most_sessions); count > 0; --count) add_session(world, wanted);
}

bool TapeScript::has(Kind kind) const {
  return std::ranges::find(items_, kind, &TapeItem::kind) != items_.end();
}

bool NumberedFrame::begins(ByteView data) {
  return data.size() >= kSize && std::ranges::equal(data.first(kStart.size()), kStart);
}

// Its start stands nowhere else, and nothing ends with a part of it, which would be held back.
void NumberedFrame::put(Bytes& data) {
  for (Byte& byte : data) byte ^= byte == kStart[0] ? Byte{1} : Byte{0};
  if (data.size() >= kSize) std::ranges::copy(kStart, data.begin());
}

void TapeScript::number() {
  reads_.clear();
  writes_.clear();
  for (TapeItem& item : items_) {
    NumberedFrame::put(item.data);
    Bytes& all = item.reads() ? reads_ : writes_;
    all.insert(all.end(), item.data.begin(), item.data.end());
  }
}

// Some time after what is there. Two blocks never have one stamp.
void TapeScript::add(World& world, TapeItem item) {
  if (!items_.empty()) now_ += std::chrono::duration_cast<Micros>(world.some_time(longest_gap_)) + Micros(2);
  item.at = now_;
  Bytes& all = item.reads() ? reads_ : writes_;
  all.insert(all.end(), item.data.begin(), item.data.end());
  items_.push_back(std::move(item));
}

void TapeScript::add_session(World& world, const Wanted& wanted) {
  add(world, {Kind::open});
  bool ended = false;
  for (auto count = world.between(1, wanted.most_sessions > 1 ? 6 : 12); count > 0; --count) {
    const auto what = wanted.only_bytes ? world.between(20, 99) : world.between(0, 99);
    if (what < 4) {
      add(world, {.kind = Kind::mark});
    } else if (what < 8) {
      add(world,
          {.kind = Kind::gap, .bytes = wanted.gaps ? static_cast<std::uint64_t>(world.between(0, 40)) : 0});
    } else if (what < 16) {
      add(world, {.kind = Kind::settings, .baud = 300 * static_cast<unsigned>(world.between(1, 4))});
    } else if (what < 20) {
      add(world, {.kind = Kind::flush});
    } else {
      const auto size = static_cast<std::size_t>(world.between(1, 1 << world.between(0, 12)));
      add(world,
          {.kind = world.chance(0.5) || ended ? Kind::read : Kind::write, .data = world.some_bytes(size)});
    }
    if (wanted.half_closes && !wanted.only_bytes && !ended && world.chance(0.03)) {
      add(world, {.kind = Kind::driver_ends});
      ended = true;
    }
  }
  if (wanted.hang_ups && !wanted.only_bytes && world.chance(0.1)) {
    add(world, {.kind = Kind::hang_up});
  } else if (!wanted.only_bytes && !ended && wanted.half_closes && world.chance(0.1)) {
    add(world, {.kind = Kind::device_ends});
  }
  add(world, {.kind = Kind::close});
}

void TapeScript::write_tape(World& world, const std::string& name, const std::string& who) const {
  Result<TapeWriter> tape = TapeWriter::create(
      literal_tape(name), {.device = "simulated", .driver = "simulated", .stamped = Stamped::arrival}, {});
  if (!tape) return world.wrong("{}", tape.error().message);
  for (const TapeItem& item : items_) {
    const TapeTime at{item.at};
    world.trace("{}: the tape has at {} us {}", who, item.at.count(), to_text(item));
    switch (item.kind) {
      case Kind::open:
        tape->event(at, event::Open{});
        break;
      case Kind::close:
        tape->event(at, event::Close{});
        break;
      case Kind::read:
        tape->read_block(at, item.data);
        break;
      case Kind::write:
        tape->write_block(at, item.data);
        break;
      case Kind::settings:
        tape->event(at, event::Settings{Side::driver, {.baud = item.baud}, SettingsOrder::sampled});
        break;
      case Kind::driver_ends:
        tape->event(at, event::HalfClose{Side::driver});
        break;
      case Kind::device_ends:
        tape->event(at, event::HalfClose{Side::device});
        break;
      case Kind::hang_up:
        tape->event(at, event::DeviceLost{"simulated", true});
        break;
      case Kind::flush:
        tape->event(at, event::Flush{FlushQueue::in});
        break;
      case Kind::mark:
        tape->event(at, event::Mark{"a note"});
        break;
      case Kind::gap:
        tape->event(at, event::Gap{.bytes = item.bytes, .from = std::nullopt, .why = "simulated"});
        break;
    }
  }
  if (const Result<void> done = tape->finish(TapeTime{now_ + Micros(1)}); !done)
    world.wrong("{}", done.error().message);
}

std::string to_text(const TapeItem& item) {
  switch (item.kind) {
    case Kind::open:
      return "an open";
    case Kind::close:
      return "a close";
    case Kind::read:
      return fmt::format("{} bytes read", item.data.size());
    case Kind::write:
      return fmt::format("{} bytes written", item.data.size());
    case Kind::settings:
      return fmt::format("{} baud, set by the driver", item.baud);
    case Kind::driver_ends:
      return "the driver's half-close";
    case Kind::device_ends:
      return "the device's half-close";
    case Kind::hang_up:
      return "a hang-up";
    case Kind::flush:
      return "a flush of the driver's input";
    case Kind::mark:
      return "a mark";
    case Kind::gap:
      break;
  }
  return fmt::format("a gap of {} bytes", item.bytes);
}

}  // namespace porttape::simulation
