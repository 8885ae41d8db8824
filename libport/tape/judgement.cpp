#include "libport/tape/judgement.hpp"

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <iterator>
#include <utility>

#include "libport/tape/end_check.hpp"

namespace porttape {
namespace {

constexpr std::string_view kUnseen = "a missing, swapped, shortened or foreign file would not be seen";

std::string plural(std::uint64_t count, std::string_view what) {
  return std::to_string(count) + " " + std::string(what) + (count == 1 ? "" : "s");
}

std::string in_seconds(TapeTime time) {
  std::array<char, 40> text{};
  const std::int64_t us = to_us(time);
  std::snprintf(text.data(), text.size(), "%" PRId64 ".%06" PRId64 " s", us / 1'000'000, us % 1'000'000);
  return text.data();
}

HeldFile held(const FileSummary& file) {
  return {file.path, file.exists, file.damage.has_value(), file.totals()};
}

std::string text_of(const GapSummary& gap, const std::string& events) {
  std::string text = events + ": a gap from " + in_seconds(gap.from) + " to " + in_seconds(gap.at) + ", ";
  text += gap.bytes > 0 ? plural(gap.bytes, "byte") : "events or an unknown number of bytes";
  return gap.why.empty() ? text : text + ": " + gap.why.for_line();
}

// Notes that keep a tape from being called sound.
std::vector<std::string> flaws_of(const TapeSummary& tape) {
  std::vector<std::string> flaws = tape.torn_tails();
  const EventsSummary& events = tape.events;
  if (tape.being_written) {
    flaws.emplace_back("it is being written; this is what has come so far");
  } else if (events.exists && !events.ended && !events.damage && events.count<event::End>() > 0) {
    flaws.push_back(events.path + " has events behind its end, which tells nothing of them; " +
                    std::string(kUnseen));
  } else if (events.exists && !events.ended && !events.damage) {
    flaws.push_back(events.path + " has no end: its recorder was killed, or it is shortened; " +
                    std::string(kUnseen));
  }
  if (events.exists && !events.end_read) {
    for (const FileSummary* file : {&tape.read, &tape.write}) {
      if (!file->exists) flaws.push_back(file->path + " is missing; what it held is not known");
    }
  }
  for (const GapSummary& gap : events.gaps) flaws.push_back(text_of(gap, events.path));
  if (const std::uint64_t count = events.count<event::Gap>(); count > events.gaps.size()) {
    flaws.push_back(events.path + ": " + plural(count - events.gaps.size(), "more gap"));
  }
  return flaws;
}

// What cannot be checked; none where everything was.
std::vector<std::string> unchecked_of(const TapeSummary& tape) {
  const EventsSummary& events = tape.events;
  if (!events.exists) return {"no events file, so no digests: " + std::string(kUnseen)};
  if (!events.ended) return {};  // a flaw, which says so
  const std::string& name = events.path;
  if (!events.end_read || !events.end_write)
    return {"no digests in " + name + ", nor how much it was: " + std::string(kUnseen)};
  if (!events.header || events.header->id.empty())
    return {"no id in " + name +
            ", so no digests are compared: changed bytes, or another tape's of the same "
            "length, would not be seen"};
  if (!events.end_read->xxh3 || !events.end_write->xxh3)
    return {"no digests in " + name +
            ": changed bytes, or another tape's of the same length, would not be seen"};
  if (tape.read.bytes > 0 && tape.read.totals() == tape.write.totals())
    return {tape.read.path + " and " + tape.write.path + " hold the same bytes: a swap would not be seen"};
  return {};
}

// What another or an older recorder did not vouch for.
std::vector<std::string> uncovered_of(const TapeSummary& tape) {
  const EventsSummary& events = tape.events;
  if (!events.exists) return {"times and events are not covered: a changed one would not be seen"};
  const bool covered =
      events.covers_lines && events.end_read && events.end_read->xxh3_all && events.end_write->xxh3_all;
  if (!events.ended || covered) return {};
  return {"times and events are not covered: " + events.path +
          " has no digests of them, so a changed one would not be seen"};
}

}  // namespace

Judgement judge(const TapeSummary& tape) {
  Judgement judgement;
  for (const Error& damage : tape.damages()) judgement.damages.push_back(damage.message);
  const EventsSummary& events = tape.events;
  const bool has_totals = events.end_read && events.end_write;
  if (has_totals && !tape.being_written) {
    EndFindings found = compare_with_end(held(tape.read), held(tape.write),
                                         {events.end_read, events.end_write, {}}, events.path);
    std::ranges::move(found.damages, std::back_inserter(judgement.damages));
    judgement.notes = std::move(found.notes);
  }
  const std::vector<std::string> flaws = flaws_of(tape);
  judgement.notes.insert(judgement.notes.end(), flaws.begin(), flaws.end());
  const std::vector<std::string> unchecked = unchecked_of(tape);
  if (judgement.damages.empty()) {
    judgement.notes.insert(judgement.notes.end(), unchecked.begin(), unchecked.end());
    const std::vector<std::string> uncovered = uncovered_of(tape);
    judgement.notes.insert(judgement.notes.end(), uncovered.begin(), uncovered.end());
  }
  using Verdict = Judgement::Verdict;
  judgement.verdict = !judgement.damages.empty() ? Verdict::damaged
                      : !flaws.empty()           ? Verdict::flawed
                      : !unchecked.empty()       ? Verdict::unchecked
                                                 : Verdict::sound;
  return judgement;
}

std::string_view words_of(Judgement::Verdict verdict) {
  switch (verdict) {
    case Judgement::Verdict::sound:
      return "sound";
    case Judgement::Verdict::unchecked:
      return "no damage found, as far as it can be checked";
    case Judgement::Verdict::flawed:
      return "no damage found";
    case Judgement::Verdict::damaged:
      return "damaged";
  }
  std::abort();
}

std::string_view to_string(Judgement::Verdict verdict) {
  switch (verdict) {
    case Judgement::Verdict::sound:
      return "sound";
    case Judgement::Verdict::unchecked:
      return "unchecked";
    case Judgement::Verdict::flawed:
      return "no-damage-found";
    case Judgement::Verdict::damaged:
      return "damaged";
  }
  std::abort();
}

}  // namespace porttape
