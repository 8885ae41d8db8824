// What a report tells a person of how the tape was played.

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "libport/replay/report.hpp"
#include "libport/replay/seconds_text.hpp"

namespace porttape {
namespace {

std::string times(std::uint64_t count) { return count == 1 ? "once" : std::to_string(count) + " times"; }

std::string seconds(TapeTime time) { return seconds_text(to_us(time)); }
std::string seconds(Micros time) { return seconds_text(time.count()); }

std::string line(std::string_view label, const std::vector<std::string>& facts) {
  std::string out;
  for (const std::string& fact : facts) out += (out.empty() ? "" : ", ") + fact;
  return facts.empty() ? "" : "  " + std::string(label) + out + '\n';
}

std::string plan(const PlaybackReport& played) {
  std::vector<std::string> facts;
  if (played.start > TapeTime{} || played.end) {
    facts.push_back("the tape from " + seconds(played.start) +
                    (played.end ? " to " + seconds(*played.end) : "") +
                    (played.preroll ? ", the handshake before it" : ""));
  }
  if (played.max_gap) facts.push_back("gaps cut to " + seconds(*played.max_gap));
  if (played.loops_of != 1) {
    const std::string of = played.loops_of ? " of " + std::to_string(*played.loops_of) : "";
    facts.push_back(std::to_string(played.loops_complete) + of +
                    (played.loops_of || played.loops_complete != 1 ? " loops" : " loop") + " complete");
  }
  return line("played    ", facts);
}

std::string steering(const PlaybackReport& played) {
  std::vector<std::string> facts;
  const auto add = [&facts](std::uint64_t count, const std::string& what) {
    if (count > 0) facts.push_back(what + ' ' + times(count));
  };
  add(played.pauses, "paused");
  if (played.pauses > 0) facts.back() += " for " + seconds(std::chrono::floor<Micros>(played.paused));
  add(played.steps, "stepped");
  add(played.seeks, "sought");
  add(played.rates, "rate changed");
  return line("by hand   ", facts);
}

}  // namespace

std::string to_text(const PlaybackReport& played) { return plan(played) + steering(played); }

}  // namespace porttape
