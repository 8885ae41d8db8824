#include "libport/taped/tape_facts.hpp"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <string_view>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/port/port_options.hpp"
#include "libport/port/spelling.hpp"
#include "libport/tape/block.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/end_check.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {
namespace {

void add_fact(const TapeEvent& told, const SessionSearch& search, Engine::TapeFacts& facts) {
  const auto& [at, event] = told;
  if (!search.inside()) return;
  if (const auto* lost = std::get_if<event::DeviceLost>(&event); lost && lost->hung_up) {
    facts.hang_ups.push_back(at);
  }
  if (const auto* gap = std::get_if<event::Gap>(&event)) {
    facts.gaps.push_back({gap->from.value_or(TapeTime{}), at, gap->bytes, gap->why});
  }
}

// Of a part alone, counted from its beginning.
void keep_part(const TapePart& part, Engine::TapeFacts& facts) {
  if (part.session == 0) return;
  facts.opens = 1;
  for (TapeTime& at : facts.hang_ups) at = part.shifted(at);
  for (TapeGap& gap : facts.gaps) {
    gap.from = part.shifted(std::max(gap.from, part.from));
    gap.to = part.shifted(gap.to);
  }
}

// Up to the part's end, and the session's begin in which its start lies.
struct Opens {
  std::uint64_t count = 0;
  std::optional<TapeTime> begun;

  void on_event(const TapeEvent& told, const PlayedPart& played) {
    const bool opens = std::holds_alternative<event::Open>(told.what);
    if (opens && (!played.end || told.at < *played.end)) ++count;
    if (told.at > played.start) return;
    if (opens) begun = told.at;
    if (std::holds_alternative<event::Close>(told.what)) begun.reset();
  }
};

Error wrong_size(const std::string& path, const std::string& found, const PayloadTotals& told) {
  return make_error(
      Errc::damaged_tape,
      fmt::format("{} {}, and by its tape's end it has {} ({} blocks); `porttape verify` says more", path,
                  found, told.bytes + told.blocks * kHeaderSize, told.blocks));
}

// What the `end` event tells of an r or w file, beside the file's size: one that is missing, shortened or
// another's is not played, since nobody could say what is missing in it.
Result<void> check_size(const std::string& path, const std::optional<PayloadTotals>& told) {
  if (!told) return {};
  const std::uint64_t recorded = told->bytes + told->blocks * kHeaderSize;
  const auto flaw = [&](const std::string& found) { return wrong_size(path, found, *told); };
  std::error_code unknown;
  const bool is_missing = !std::filesystem::exists(path, unknown);
  if (unknown) return {};
  if (is_missing) return told->blocks == 0 ? Result<void>() : flaw("is missing");
  const std::uintmax_t size = std::filesystem::file_size(path, unknown);
  const bool as_told = size >= recorded;  // what is beyond shows by reading
  return unknown || as_told ? Result<void>() : flaw(fmt::format("has {} bytes", size));
}

// How much an r or w file has beyond what its tape's end tells of, as a note.
std::optional<std::string> beyond(const std::string& path, const std::optional<PayloadTotals>& told) {
  if (!told) return std::nullopt;
  const std::uint64_t recorded = told->bytes + told->blocks * kHeaderSize;
  std::error_code unknown;
  const std::uintmax_t size = std::filesystem::file_size(path, unknown);
  if (unknown || size <= recorded || size == told->bytes + told->blocks * kMaxHeaderSize) return std::nullopt;
  return fmt::format("{} has {} bytes behind the last block that its tape's end tells of; they do not count",
                     path, size - recorded);
}

Error no_such_session(const TapePaths& tape, std::uint64_t session, std::uint64_t sessions) {
  return make_error(Errc::usage,
                    fmt::format("option 'session': tape '{}' has {} session{}, and no number {}; `porttape "
                                "info` lists them",
                                tape.name(), sessions, sessions == 1 ? "" : "s", session));
}

}  // namespace

std::vector<Doubt> doubts_of(const TapeFacts& tape) {
  std::vector<Doubt> doubts;
  if (tape.ended == false) {
    doubts.push_back(
        {Doubt::Kind::gap,
         tape.end_passed
             ? "events stand behind the tape's end, which tells nothing of them: what came with them may "
               "be missing"
             : "the tape has no end: its recorder was killed, or still writes; what came last may be "
               "missing"});
  }
  for (const std::string& stray : tape.stray) doubts.push_back({Doubt::Kind::gap, stray});
  if (!tape.missing.empty()) {
    doubts.push_back(
        {Doubt::Kind::unchecked, fmt::format("{} is missing, and the tape's end does not tell what it held: "
                                             "whether it held nothing is not known",
                                             printable_line(tape.missing))});
  }
  return doubts;
}

Result<TapeFacts> tape_facts(const TapePaths& tape, const PlayedPart& played) {
  const std::uint64_t session = played.session;
  TapeFacts known;
  Engine::TapeFacts& facts = known.facts;
  SessionSearch search(session);
  Opens opens;
  std::optional<event::End> end;
  std::error_code unknown;
  if (std::filesystem::exists(tape.events, unknown)) {
    Result<std::unique_ptr<FileSource>> source = FileSource::open(tape.events);
    if (!source) return source.error();
    Result<EventFile> events = EventFile::create(std::move(*source));
    if (!events) return events.error();
    EventFile::Step step{};
    while ((step = events->next()) == EventFile::Step::event) {
      const TapeEvent& told = events->event();
      if (std::holds_alternative<event::Open>(told.what)) search.on_open(told.at);
      add_fact(told, search, facts);
      // An end with something behind it tells nothing of that, and is none.
      const auto* last = std::get_if<event::End>(&told.what);
      known.end_passed = known.end_passed || (end && last == nullptr);
      end = last != nullptr ? std::optional(*last) : std::nullopt;
      if (session == 0) opens.on_event(told, played);
      if (search.inside()) known.last = told.at;
      known.line.on_event(told.what, search.inside());
      if (std::holds_alternative<event::Close>(told.what)) search.on_close(told.at);
    }
    if (step == EventFile::Step::failed) return events->error();
    known.ended = end.has_value();
    if (end && end->read && end->write) facts.totals = TapeTotals{end->read->bytes, end->write->bytes};
    known.checkable = end && end->read && end->write && end->read->xxh3 && has_digests(events->header());
    std::optional<Error> longer;
    if (end) {
      for (const auto& [path, told] : {std::pair(tape.read, end->read), std::pair(tape.write, end->write)}) {
        if (Result<void> whole = check_size(path, told); !whole && !known.flaw) known.flaw = whole.error();
        std::error_code error;
        if (!told && !std::filesystem::exists(path, error)) known.missing = path;
        const auto more = beyond(path, told);
        if (!more) continue;
        known.stray.push_back(*more);
        if (!longer)
          longer =
              wrong_size(path, fmt::format("has {} bytes", std::filesystem::file_size(path, error)), *told);
      }
    }
    if (const auto torn = events->torn_tail(); torn && end) known.stray.push_back(*torn);
    if (!known.flaw && !known.stray.empty()) {
      // More than the end tells of: bytes that do not count, or another file's.
      const auto check = check_tape(tape);
      if (check && !check->found) known.flaw = longer ? *longer : check->found.error();
    }
    if (const auto& header = events->header()) known.zero = header->zero;
  }
  // No matter where something else of the tape comes behind the part.
  if (played.end || (session > 0 && session < search.opens())) known.ended.reset();
  facts.line = known.line.before();
  const std::optional<TapePart> part = search.found();
  if (!part) return no_such_session(tape, session, std::max<std::uint64_t>(1, search.opens()));
  known.part = *part;
  known.last = known.part.shifted(known.last);
  if (session == 0) facts.opens = opens.count;
  facts.preroll_from = session > 0 || search.opens() == 0 ? TapeTime{} : opens.begun;
  keep_part(known.part, facts);
  if (played.end) known.part.until = *played.end;
  if (!known.part.whole() || played.start > TapeTime{}) facts.totals.reset();
  return known;
}

std::optional<TapeCheck> check_tape(const TapePaths& tape, const GiveUp& give_up) {
  Result<TapeReader> reader = TapeReader::open(tape);
  if (!reader) return TapeCheck{reader.error(), false};
  for (unsigned looked = 1;; ++looked) {
    if (looked % kRecordsBetweenLooks == 0 && give_up && give_up()) return std::nullopt;
    const auto record = reader->next();
    if (!record) return TapeCheck{record.error(), reader->came_to_end()};
    if (!*record) return TapeCheck{{}, true};
  }
}

std::optional<LineSettings> own_settings(const DeviceLine& line, const std::optional<TapeHeader>& header) {
  if (const auto own = line.own()) return own->over(LineSettings{});
  constexpr std::string_view serial = "serial:";
  if (!header || !header->device.raw().starts_with(serial)) return std::nullopt;
  PortType settings_alone;
  settings_alone.options = line_setting_options();
  OptionValues values;
  for (const std::string_view token : split_tokens(header->device.raw(), ",")) {
    const auto [option, value] = split_option(token);
    const bool known =
        std::ranges::find(settings_alone.options, option, &OptionSpec::name) != settings_alone.options.end();
    if (known) values[option] = value;
  }
  const Result<PortOptions> written = check_options(PortOptions{&settings_alone, std::move(values)});
  return written ? std::optional(line_settings(*written)) : std::nullopt;
}

}  // namespace porttape
