#include "libport/taped/replay_sources.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fmt/format.h>
#include <system_error>
#include <utility>

#include "libport/replay/pieces.hpp"
#include "libport/replay/seconds_text.hpp"
#include "libport/replay/tape_count.hpp"
#include "libport/taped/tape_facts.hpp"

namespace porttape {
namespace {

constexpr std::uintmax_t kSmallTape = 65536;  // bytes of its files

// Whether it is read in no time.
bool is_small(const TapePaths& paths) {
  std::uintmax_t size = 0;
  for (const auto& path : {paths.read, paths.write}) {
    std::error_code absent;
    const std::uintmax_t bytes = std::filesystem::file_size(path, absent);
    if (!absent) size += bytes;
  }
  return size <= kSmallTape;
}

std::optional<TapeTotals> count_at_once(RecordSource& tape, TapeTime start) {
  const std::optional<TapeTotals> totals = count_tape(tape, {}, start);
  return tape.rewind() ? totals : std::nullopt;
}

// Whether the tape has anything from the start on.
Result<void> check_start(const ReplayOptions& options, RecordSource& tape) {
  const TapeTime start = options.config.start;
  TapeTime last{};
  while (start > TapeTime{}) {
    const auto record = tape.next();
    if (!record) return record.error();
    if (!*record) {
      return make_error(Errc::usage,
                        fmt::format("option 'start' is {} s, and nothing of tape '{}' is there; accepted: a "
                                    "time before its end, 0 to {:.6f} s",
                                    seconds_of(start), options.tape.name(), seconds_of(last)));
    }
    const bool is_block = (*record)->kind == RecordKind::read || (*record)->kind == RecordKind::write;
    if (is_block) last = (*record)->at;
    if (is_block && last >= start) break;
  }
  return start > TapeTime{} ? tape.rewind() : Result<void>();
}

bool are_datagrams(const std::optional<TapeHeader>& header) {
  if (!header) return false;
  return header->transport ? *header->transport == Transport::datagram
                           : header->device.raw().starts_with("udp");
}

// For a driver whose requests are looked for wherever the tape has them.
Result<void> open_index(const ReplayOptions& options, ReplaySources& sources) {
  const bool drives = options.config.writer == Writer::device;
  const bool resyncs = options.config.on_mismatch == OnMismatch::resync && !drives;
  if (options.config.match == Match::sequence && !resyncs) return {};
  if (drives) {
    return make_error(Errc::usage,
                      "option 'match': a tape that plays the driver asks in its own order; leave it out");
  }
  Result<std::unique_ptr<PlayedTape>> index = PlayedTape::open(options.tape, sources.as);
  if (!index) return index.error();
  sources.index = std::move(*index);
  Result<std::unique_ptr<TapeAnswers>> answers = TapeAnswers::open(options.tape, sources.as.part);
  if (!answers) return answers.error();
  sources.answers = std::move(*answers);
  return {};
}

}  // namespace

Result<ReplaySources> ReplaySources::open(const ReplayOptions& options) {
  const ReplayConfig& config = options.config;
  Result<TapeFacts> known = tape_facts(options.tape, {options.session, config.start, config.end});
  if (!known) return known.error();
  ReplaySources sources;
  sources.as = {known->part, config.writer};
  Result<std::unique_ptr<PlayedTape>> schedule = PlayedTape::open(options.tape, sources.as);
  if (!schedule) return schedule.error();
  sources.schedule = std::move(*schedule);
  Result<std::unique_ptr<PlayedTape>> writes =
      PlayedTape::open(options.tape, sources.as, PlayedTape::Select::compared);
  if (!writes) return writes.error();
  sources.writes = std::move(*writes);
  if (known->flaw) return *known->flaw;
  const bool small = is_small(options.tape);
  const bool check_now = known->checkable && small;
  const std::optional<TapeCheck> checked = check_now ? check_tape(options.tape) : std::nullopt;
  if (checked && checked->whole && !checked->found) return checked->found.error();
  sources.unchecked = known->checkable && !check_now;
  sources.header = sources.schedule->header();
  sources.datagrams = are_datagrams(sources.header);
  sources.facts = std::move(known->facts);
  sources.facts.stamped_at_arrival = sources.header && sources.header->stamped
                                         ? *sources.header->stamped == Stamped::arrival
                                         : sources.schedule->has_events();
  if (sources.datagrams && Pieces(config.chunks, 0).cut()) {
    return make_error(Errc::usage,
                      fmt::format("option 'chunks': tape '{}' is of datagrams, which come whole; leave it "
                                  "out",
                                  options.tape.name()));
  }
  sources.line = std::move(known->line);
  sources.zero = known->zero;
  sources.ended = known->ended;
  sources.doubts = doubts_of(*known);
  sources.settings = own_settings(sources.line, sources.header);
  if (Result<void> there = check_start(options, *sources.schedule); !there) return there.error();
  if (known->last > TapeTime{}) sources.length = std::min(known->last, config.end.value_or(known->last));
  // Where the tape plays the driver, what is compared is counted, and that may be less.
  if (config.writer == Writer::device) sources.facts.totals.reset();
  if (const auto counted = small ? count_at_once(*sources.schedule, config.start) : std::nullopt)
    sources.facts.totals = counted;
  if (Result<void> opened = open_index(options, sources); !opened) return opened.error();
  return sources;
}

std::vector<Doubt> ReplaySources::doubts_of_run() const {
  std::vector<Doubt> found = doubts;
  if (const auto torn = ended ? std::nullopt : schedule->torn_tail())
    found.push_back({Doubt::Kind::gap, *torn + ": what came last may be missing"});
  return found;
}

}  // namespace porttape
