// `porttape cut`: a part of a tape as a tape of its own.

#include <array>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/tape/cut_tape.hpp"
#include "libport/tape/source_mode.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kCutHelp{
    "cut", "TAPE (--from S | --to S | --exchange A..B | --mark TEXT..TEXT) -o NAME",
    "Makes a tape of a part of another: blocks and events as they are, unknown ones too. What\n"
    "held on the line before (the open, settings, modem lines) stands at its beginning, so that\n"
    "it replays. Times stay what they were; with --rebase the first thing kept is at 0. Ranges\n"
    "are open where a side is left out: --exchange 7.. is all from the seventh on. The tape is\n"
    "read to its end, which tells whether its bytes are what was recorded; of one whose blocks\n"
    "break off behind the part, that has no end of its own. Exit status: 0, 1 the tape is damaged\n"
    "or a file cannot be read or written, 2 wrong use, or nothing is in the range.\n",
    "  porttape cut laser.log --from 12.5 --to 14 -o part\n"
    "  porttape cut laser.log --exchange 17 --rebase -o one\n"
    "  porttape cut laser.log --mark 'arm moves..arm stops' -o moving\n"};

// "A..B", "A..", "..B" or "A", which is both.
std::pair<std::string_view, std::string_view> sides_of(std::string_view text) {
  const std::size_t dots = text.find("..");
  if (dots == std::string_view::npos) return {text, text};
  return {text.substr(0, dots), text.substr(dots + 2)};
}

Error wrong_value(std::string_view option, std::string_view value, std::string_view wanted) {
  return make_error(Errc::usage, fmt::format("option '{}': {} {}", option, in_quotes(value), wanted));
}

Result<CutRange> read_times(const CommandLine& line) {
  TimeRange range;
  for (const auto& [name, time] : {std::pair{"from", &range.from}, std::pair{"to", &range.to}}) {
    const auto text = line.text(name);
    if (!text) continue;
    const auto seconds = parse_seconds(*text);
    if (!seconds) return wrong_value(name, *text, "is no time; it is in seconds, e.g. 12.5");
    *time = *seconds;
  }
  if (range.to <= range.from) return wrong_value("to", *line.text("to"), "must be later than --from");
  return CutRange(range);
}

Result<CutRange> read_exchanges_of(const std::string& text) {
  const auto [first, last] = sides_of(text);
  ExchangeRange range;
  const auto take = [](std::string_view side, std::uint64_t& number) {
    if (side.empty()) return true;
    const auto read = whole_number<std::uint64_t>(side);
    number = read.value_or(0);
    return number > 0;
  };
  const bool numbers = take(first, range.first) && take(last, range.last);
  if (!numbers || (first.empty() && last.empty()) || range.last < range.first)
    return wrong_value("exchange", text,
                       "is no range of exchanges, which are counted from 1: 4..7, 4.. or 4");
  return CutRange(range);
}

Result<CutRange> read_marks(const std::string& text) {
  if (text.find("..") == std::string::npos || text == "..")
    return wrong_value("mark", text, "is no range of marks: 'begin..end', 'begin..' or '..end'");
  const auto [first, last] = sides_of(text);
  MarkRange range;
  if (!first.empty()) range.first = first;
  if (!last.empty()) range.last = last;
  return CutRange(range);
}

Result<CutRange> read_range(const CommandLine& line) {
  const bool times = line.has("from") || line.has("to");
  const auto exchanges = line.text("exchange");
  const auto marks = line.text("mark");
  const std::string time = line.has("from") ? "from" : "to";
  if (times + exchanges.has_value() + marks.has_value() > 1)
    return make_error(Errc::usage, fmt::format("options '{}' and '{}' do not go together; choose one",
                                               times ? time : "exchange", marks ? "mark" : "exchange"));
  if (times) return read_times(line);
  if (exchanges) return read_exchanges_of(*exchanges);
  if (marks) return read_marks(*marks);
  return make_error(Errc::usage,
                    "nothing says what is to be kept; accepted: --from, --to, --exchange, --mark");
}

void tell_cut(const CutTape& cut, const TapePaths& from, std::ostream& out) {
  fmt::print(out, "{}: {} and {}, {} to {} s of {}\n", printable_line(cut.paths.name()),
             counted(cut.blocks, "block"), counted(cut.events, "event"), seconds_number(to_us(cut.from)),
             seconds_number(to_us(cut.to)), printable_line(from.name()));
}

}  // namespace

int run_cut(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kCutHelp);
  line.value("from", "S", "from this second on")
      .value("to", "S", "up to this second, which is not included")
      .value("exchange", "A..B", "these exchanges, as porttape info counts them, from 1")
      .value("mark", "TEXT..TEXT", "from one mark to another, both included")
      .flag("rebase", "the first thing kept is at time 0");
  add_new_tape_options(line);
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<NewTapeName> to = read_new_tape(line);
  if (!to) return line.usage_error(err, to.error().message);
  Result<CutRange> range = read_range(line);
  if (!range) return line.usage_error(err, range.error().message);
  const Result<TapePaths> from = the_tape(line);
  if (!from) return line.usage_error(err, from.error().message);
  if (const auto free = check_new_tape(to->paths, to->writer); !free)
    return fail_verb("cut", free.error(), out, err);
  const ModeOfSources mode(*from);
  Progress progress(err, "cut", size_of_tape(*from));
  const Result<CutTape> cut = cut_tape(*from, to->paths,
                                       {.range = std::move(*range),
                                        .rebased = line.has("rebase"),
                                        .writer = to->writer,
                                        .progress = [&](std::uint64_t bytes) { progress.at(bytes); }});
  progress.clear();
  if (!cut) return fail_verb("cut", cut.error(), out, err);
  tell_cut(*cut, *from, out);
  out.flush();
  if (cut->half) tell_half("cut", *cut->half, err);
  if (cut->damage_behind)
    fmt::print(
        err,
        "porttape cut: warning: the tape is damaged behind the part, which has no end therefore, so that "
        "its bytes are not vouched for: {}\n",
        printable_line(cut->damage_behind->message));
  return exit_status::kPass;
}

}  // namespace porttape
