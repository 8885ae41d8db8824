// `porttape unpack`: what was packed, checked, in a new folder.

#include "libport/pack/unpack.hpp"

#include <fmt/format.h>
#include <fmt/ostream.h>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr VerbHelp kUnpackHelp{
    "unpack", "FILE -o DIR",
    "Unpacks what `porttape pack` made into a new folder, and checks all of it: names, sizes,\n"
    "digests, and that each tape is as sound as it was. The folder appears when everything is\n"
    "right; a pack with anything else in it (links, paths, files that its manifest does not tell\n"
    "of) gives nothing. Exit status: 0, 1 the pack is damaged or not what it tells, or something\n"
    "cannot be read or written, 2 wrong use, or it is no pack.\n",
    "  porttape unpack bug.tar.zst -o bug\n"};

void tell_unpacked(const PackManifest& pack, const std::string& folder, std::ostream& out) {
  fmt::print(out, "{}: {}, packed {} by {}\n", printable_line(folder), counted(pack.tapes.size(), "tape"),
             pack.created.for_line(), pack.tool.for_line());
  for (const PackedTape& tape : pack.tapes)
    fmt::print(out, "  tape {}: {}\n", printable_line(tape.name), tape.verdict.for_line());
  if (!pack.driver_version.empty()) fmt::print(out, "  driver: {}\n", pack.driver_version.for_line());
  if (!pack.driver_command.empty()) fmt::print(out, "  command: {}\n", pack.driver_command.for_line());
  for (const auto& [key, value] : pack.system)
    fmt::print(out, "  {}: {}\n", printable_line(key), value.for_line());
  if (pack.redaction) fmt::print(out, "  redacted: {} tells what\n", kRedactionName);
}

}  // namespace

int run_unpack(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kUnpackHelp);
  line.value("output,o", "DIR", "the folder that is to be made")
      .value("max-size", "MB", "the most that it may unpack to, in megabytes (100, or 100 times the pack)")
      .takes_words();
  if (const auto done = line.parse(args, out, err)) return *done;
  if (line.words().empty()) return line.usage_error(err, "a pack is missing: FILE");
  if (line.words().size() > 1) return line.usage_error(err, "more than one pack given");
  if (line.words().front() == "-")
    return line.usage_error(err, "a pack is checked before it is unpacked, which - cannot be; name its file");
  const auto folder = line.text("output");
  if (!folder || folder->empty())
    return line.usage_error(err, "option 'output' is missing: -o DIR, the folder that is to be made");
  PackLimits limits;
  if (const auto text = line.text("max-size")) {
    const auto megabytes = whole_number<std::uint32_t>(*text);
    if (!megabytes || *megabytes == 0)
      return line.usage_error(
          err, fmt::format("option 'max-size': {} is no number of megabytes", in_quotes(*text)));
    limits.bytes = std::uint64_t{*megabytes} * 1'000'000;
  }
  const Result<PackManifest> pack = unpack(line.words().front(), *folder, limits);
  if (!pack) return fail_verb("unpack", pack.error(), out, err);
  tell_unpacked(*pack, *folder, out);
  return exit_status::kPass;
}

}  // namespace porttape
