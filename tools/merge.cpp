// `porttape merge`: several tapes as one.

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/tape/merge_tapes.hpp"
#include "libport/tape/source_mode.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kMergeHelp{
    "merge", "TAPE TAPE... [--offset S,...] -o NAME",
    "Makes one tape of several, in the order of time: tapes that were recorded on one machine\n"
    "since its last boot by their common clock, parts of a tape (porttape split) as they were in\n"
    "it, others one after the other, or as --offset says. The new tape has the header of the one\n"
    "that begins first. Exit status: 0, 1 a tape is damaged or a file cannot be read or written,\n"
    "2 wrong use.\n",
    "  porttape merge laser.log laser.2.log laser.3.log -o all\n"
    "  porttape merge arm.log laser.log --offset 12.5 -o both\n"};

// "12.5,-3": with a sign, and several.
Result<std::vector<Micros>> read_offsets(std::string_view text) {
  std::vector<Micros> offsets;
  for (std::string_view left = text;;) {
    const std::size_t comma = left.find(',');
    std::string_view one = left.substr(0, comma);
    const bool negative = one.starts_with('-');
    const auto seconds = parse_seconds(negative ? one.substr(1) : one);
    if (!seconds)
      return make_error(Errc::usage,
                        fmt::format("option 'offset': {} is no list of times; they are in seconds, "
                                    "one for each tape but the first, e.g. 12.5,-3",
                                    in_quotes(text)));
    const Micros offset = *seconds - TapeTime{};
    offsets.push_back(negative ? -offset : offset);
    if (comma == std::string_view::npos) return offsets;
    left.remove_prefix(comma + 1);
  }
}

std::string_view placed_text(MergedTape::Placed placed) {
  switch (placed) {
    case MergedTape::Placed::clock:
      return "by the clock that they share";
    case MergedTape::Placed::parts:
      return "as they were in the tape that they are parts of";
    case MergedTape::Placed::given:
      return "as the offset says";
    case MergedTape::Placed::after:
      break;
  }
  return "one after the other, since they share no clock; --offset S places them";
}

}  // namespace

int run_merge(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kMergeHelp);
  line.value("offset", "S,...",
             "when each tape but the first begins, in seconds of the first; may be below 0");
  add_new_tape_options(line);
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<NewTapeName> to = read_new_tape(line);
  if (!to) return line.usage_error(err, to.error().message);
  MergeOptions options{.offsets = {}, .writer = to->writer, .progress = {}};
  if (const auto text = line.text("offset")) {
    Result<std::vector<Micros>> offsets = read_offsets(*text);
    if (!offsets) return line.usage_error(err, offsets.error().message);
    options.offsets = std::move(*offsets);
  }
  if (line.tapes().size() < 2) return line.usage_error(err, "one tape is nothing to merge; give another");
  std::vector<TapePaths> tapes;
  std::uint64_t bytes = 0;
  for (const std::string& name : line.tapes()) {
    const Result<TapePaths> tape = find_tape(name);
    if (!tape) return line.usage_error(err, tape.error().message);
    tapes.push_back(*tape);
    bytes += size_of_tape(*tape);
  }
  if (const auto free = check_new_tape(to->paths, to->writer); !free)
    return fail_verb("merge", free.error(), out, err);
  const ModeOfSources mode(tapes);
  Progress progress(err, "merge", bytes);
  options.progress = [&](std::uint64_t done) { progress.at(done); };
  const Result<MergedTape> merged = merge_tapes(tapes, to->paths, options);
  progress.clear();
  if (!merged) return fail_verb("merge", merged.error(), out, err);
  fmt::print(out, "{}: {} and {} of {}, {} s, {}\n", printable_line(merged->paths.name()),
             counted(merged->blocks, "block"), counted(merged->events, "event"),
             counted(tapes.size(), "tape"), seconds_number(to_us(merged->end)), placed_text(merged->placed));
  out.flush();
  for (const std::string& half : merged->halves) tell_half("merge", half, err);
  return exit_status::kPass;
}

}  // namespace porttape
