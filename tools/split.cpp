// `porttape split`: the parts of a tape as tapes of their own.

#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/split_tape.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kSplitHelp{
    "split", "TAPE [--session | --at-mark | --every S | --gap S] -o NAME",
    "Makes tapes NAME.1.log, NAME.2.log, ... of the parts of a tape: by default of its sessions,\n"
    "from one open of the driver's to the next. Each block and event is in one of them, and each\n"
    "part replays: what held on the line stands at its beginning, which is its time 0. porttape\n"
    "merge makes one tape of them again. The parts appear when all are whole, and replace earlier\n"
    "ones only then. Exit status: 0, 1 the tape is damaged or a file cannot be read or written\n"
    "(then no part is made), 2 wrong use.\n",
    "  porttape split laser.log -o laser.session\n"
    "  porttape split night.log --every 3600 -o night.hour\n"
    "  porttape split laser.log --gap 30 -o laser.part\n"};

Result<SplitOptions> read_split(const CommandLine& line) {
  using At = SplitOptions::At;
  SplitOptions options;
  std::string chosen;
  for (const auto& [name, at] : {std::pair{"session", At::session}, std::pair{"at-mark", At::mark},
                                 std::pair{"every", At::every}, std::pair{"gap", At::gap}}) {
    if (!line.has(name)) continue;
    if (!chosen.empty())
      return make_error(Errc::usage,
                        fmt::format("options '{}' and '{}' do not go together; choose one", chosen, name));
    chosen = name;
    options.at = at;
    if (at != At::every && at != At::gap) continue;
    const std::string text = *line.text(name);
    const auto seconds = parse_seconds(text);
    if (!seconds || to_us(*seconds) == 0)
      return make_error(Errc::usage,
                        fmt::format("option '{}': {} is no time above 0; it is in seconds, e.g. 60", name,
                                    in_quotes(text)));
    options.span = *seconds - TapeTime{};
  }
  return options;
}

void tell_split(const std::vector<SplitPart>& parts, const TapePaths& to, const TapePaths& from,
                std::ostream& out) {
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const SplitPart& part = parts[i];
    fmt::print(out, "{}: {} and {}, {} to {} s of {}\n", printable_line(part_tape(to, i + 1).name()),
               counted(part.blocks, "block"), counted(part.events, "event"), seconds_number(to_us(part.from)),
               seconds_number(to_us(part.to)), printable_line(from.name()));
  }
}

// A merge of NAME.*.log would take them for parts of this tape.
void tell_earlier_parts(const TapePaths& to, std::uint64_t first, std::ostream& out, std::ostream& err) {
  std::uint64_t last = first;
  std::error_code ignored;
  while (std::filesystem::exists(part_tape(to, last).read, ignored)) ++last;
  if (last == first) return;
  const std::string name = printable_line(part_tape(to, first).name());
  out.flush();
  if (--last == first) {
    fmt::print(err, "porttape split: {} is not of this tape; it was there before\n", name);
  } else {
    fmt::print(err, "porttape split: {} to {} are not of this tape; they were there before\n", name,
               printable_line(part_tape(to, last).name()));
  }
}

}  // namespace

int run_split(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kSplitHelp);
  line.flag("session", "at each open of the driver's but the first (the default)")
      .flag("at-mark", "at each mark")
      .value("every", "S", "at each multiple of so many seconds")
      .value("gap", "S", "where nothing happened for so many seconds");
  add_new_tape_options(line);
  if (const auto done = line.parse(args, out, err)) return *done;
  const Result<NewTapeName> to = read_new_tape(line);
  if (!to) return line.usage_error(err, to.error().message);
  Result<SplitOptions> options = read_split(line);
  if (!options) return line.usage_error(err, options.error().message);
  const Result<TapePaths> from = the_tape(line);
  if (!from) return line.usage_error(err, from.error().message);
  if (const auto free = check_new_tape(part_tape(to->paths, 1), to->writer); !free)
    return fail_verb("split", free.error(), out, err);
  const ModeOfSources mode(*from);
  Progress progress(err, "split", size_of_tape(*from));
  options->writer = to->writer;
  options->progress = [&](std::uint64_t bytes) { progress.at(bytes); };
  const Result<std::vector<SplitPart>> parts = split_tape(*from, to->paths, *options);
  progress.clear();
  if (!parts) return fail_verb("split", parts.error(), out, err);
  tell_split(*parts, to->paths, *from, out);
  out.flush();
  if (!parts->empty() && parts->front().half) tell_half("split", *parts->front().half, err);
  tell_earlier_parts(to->paths, parts->size() + 1, out, err);
  return exit_status::kPass;
}

}  // namespace porttape
