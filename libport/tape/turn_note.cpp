#include <fmt/format.h>
#include <string>

#include "libport/tape/payload_totals.hpp"
#include "libport/tape/turn_pairs.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kEventSeed = 1;

std::uint64_t text_digest(std::string_view text) { return digest_of(as_bytes(text), kEventSeed); }

void leave_out(std::string& line, std::string_view part) {
  if (const std::size_t at = line.find(part); at != std::string::npos) line.erase(at, part.size());
}

// All that an event says but its times, and how surely settings are known to be at their place.
std::uint64_t event_digest(const Turn& turn) {
  if (std::holds_alternative<event::Drain>(turn.event)) return text_digest(event::Drain::kName);
  if (const auto* gap = std::get_if<event::Gap>(&turn.event))
    return text_digest("gap " + std::to_string(gap->bytes) + ' ' + gap->why.raw());
  std::string line = turn.line;
  std::string time = fmt::format("{{\"t_us\":{},", to_us(turn.at));
  if (!line.starts_with(time)) {
    line = encode_again(line, TapeTime{});
    line.pop_back();
    time = "{\"t_us\":0,";
  }
  if (line.starts_with(time)) line.erase(0, time.size());
  // What held before a part of a tape is what was told before.
  constexpr std::string_view carried = ",\"carried\":true}";
  if (line.ends_with(carried)) line.replace(line.size() - carried.size(), carried.size(), "}");
  if (std::holds_alternative<event::Settings>(turn.event)) {
    leave_out(line, R"(,"order":"sampled")");
    leave_out(line, R"(,"order":"exact")");
  }
  return text_digest(line);
}

// Events of one kind, and of one line or side, stand for each other.
std::uint64_t event_question(const Turn& turn) {
  std::string what(name_of(turn.event));
  if (const auto signal = signal_of(turn.event)) what += name_of(signal->signal.name);
  const auto* settings = std::get_if<event::Settings>(&turn.event);
  if (settings != nullptr && settings->by) what += *settings->by == Side::driver ? " driver" : " device";
  return text_digest(what);
}

}  // namespace

TurnNote note_of(const Turn& turn) {
  TurnNote note;
  note.is_event = turn.is_event();
  if (note.is_event) {
    note.digest = event_digest(turn);
    note.question = static_cast<std::uint32_t>(event_question(turn));
    note.is_place =
        std::holds_alternative<event::Open>(turn.event) || std::holds_alternative<event::Close>(turn.event);
    const auto* settings = std::get_if<event::Settings>(&turn.event);
    note.sampled = settings != nullptr && settings->order == SettingsOrder::sampled;
    return note;
  }
  // Where the writes end matters.
  note.digest = digest_of(turn.reads, digest_of(turn.writes, kEventSeed + 1 + turn.writes.size()));
  note.question = static_cast<std::uint32_t>(digest_of(turn.writes));
  note.wait_us = turn.wait.count();
  if (turn.answer) note.answer_us = turn.answer->count();
  return note;
}

}  // namespace porttape
