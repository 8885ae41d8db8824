// `porttape convert`: evidence of other forms as a tape, and a tape in other forms.

#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <utility>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/formats/format.hpp"
#include "libport/tape/part_writer.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_line.hpp"
#include "tools/new_tape_option.hpp"
#include "tools/private_folder.hpp"
#include "tools/progress.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr VerbHelp kConvertHelp{
    "convert", "[--from FORMAT] IN [--to FORMAT] -o OUT",
    "Makes a tape of evidence in another form, or another form of a tape; --formats lists them.\n"
    "Without --from it is told by how IN begins, without --to it is a tape, or what OUT's name\n"
    "ends in. What had to be guessed stands on the tape as marks and is told, and so is what is\n"
    "lost. IN may be -, and OUT too where it is no tape. Of an IN that is a tape --swap,\n"
    "--lead, --device and --with are wrong use, and --bytes-at but with --to sr. Exit status: 0,\n"
    "1 IN is damaged or a file cannot be read or written, 2 wrong use, or IN is not of that form.\n",
    "  porttape convert laser.log -o laser.txt\n"
    "  porttape convert laser.txt -o mended\n"
    "  porttape convert --from raw nmea.bin --bytes-at 4800 -o gps\n"};

constexpr std::string_view kTape = "tape";
constexpr const char* kBetween = "tape.log";  // from one form to another

struct ConvertPlan {
  std::string in;
  std::string out;
  const Format* from = nullptr;  // none: a tape
  const Format* to = nullptr;
  ImportOptions import_options;
  TapeWriterOptions writer;
};

int list_formats(std::ostream& out) {
  fmt::print(out, "{:<14} {:<10} {}\n", kTape, "read write", "two or three files: Xr, Xw, Xe");
  for (const Format& format : formats()) {
    fmt::print(out, "{:<14} {:<4} {:<5} {}\n", format.name, format.import_tape != nullptr ? "read" : "",
               format.export_tape != nullptr ? "write" : "", format.what);
  }
  return exit_status::kPass;
}

// Null: a tape.
Result<const Format*> named_format(const char* option, const std::string& name, bool is_read) {
  if (name == kTape) return nullptr;
  const Format* const found = find_format(name);
  if (found == nullptr) {
    std::vector<std::string_view> known{kTape};
    for (const Format& format : formats()) known.push_back(format.name);
    return make_error(Errc::usage,
                      fmt::format("option '{}': {} is unknown; type porttape convert --formats{}", option,
                                  in_quotes(name), did_you_mean(name, known)));
  }
  if ((is_read ? found->import_tape == nullptr : found->export_tape == nullptr))
    return make_error(Errc::usage,
                      fmt::format("option '{}': {} is only {}", option, name, is_read ? "written" : "read"));
  return found;
}

constexpr std::string_view kDialectSuffix = ".toml";

// What IN is: a file whose beginning or name tells, else a tape.
Result<const Format*> found_format(const std::string& in) {
  std::error_code error;
  const fs::file_status status = fs::status(in, error);
  if (in != "-" && (!fs::exists(status) || fs::is_directory(status))) {
    const Result<TapePaths> tape = find_tape(in);
    if (tape) return nullptr;
    return make_error(Errc::usage, fs::exists(status) ? in_quotes(in) + " is a folder; name a file"
                                                      : "no such file, and " + tape.error().message);
  }
  // What is read once is not looked at before.
  if (!fs::is_regular_file(status))
    return make_error(Errc::usage, fmt::format("option 'from' is missing: what {} is", printable_line(in)));
  Result<Evidence> evidence = Evidence::open(in);
  if (!evidence) return evidence.error();
  const auto head = evidence->peek();
  if (!head) return head.error();
  const std::string_view text(reinterpret_cast<const char*>(head->data()), head->size());
  const Format* const found = detect_format(text, in);
  if (found != nullptr && found->import_tape != nullptr) return found;
  if (find_tape(in)) return nullptr;
  return make_error(Errc::usage, fmt::format("{}: what it is cannot be told by how it begins; say it by "
                                             "--from FORMAT (porttape convert --formats lists them)",
                                             in_quotes(in)));
}

Result<void> read_import_options(const CommandLine& line, ImportOptions& options) {
  options.swapped = line.has("swap");
  options.device = line.text("device");
  options.with = line.text("with");
  if (const auto text = line.text("lead")) {
    const auto lead = parse_seconds(*text);
    if (!lead)
      return make_error(Errc::usage, fmt::format("option 'lead': {} is no time; it is in seconds, e.g. 2",
                                                 in_quotes(*text)));
    options.lead = *lead - TapeTime{};
  }
  if (const auto text = line.text("bytes-at")) {
    options.bytes_at = whole_number<unsigned>(*text);
    if (!options.bytes_at || *options.bytes_at == 0)
      return make_error(
          Errc::usage,
          fmt::format("option 'bytes-at': {} is no rate; it is in bit/s, e.g. 9600", in_quotes(*text)));
  }
  return {};
}

// A tape has all that these options say.
Result<void> check_options(const CommandLine& line, const ConvertPlan& plan) {
  if (plan.from != nullptr) return {};
  for (const char* const option : {"swap", "lead", "device", "with"}) {
    if (line.has(option))
      return make_error(
          Errc::usage,
          fmt::format("option '{}' has no effect on a tape; it is for what becomes one", option));
  }
  if (line.has("bytes-at") && plan.to->export_at == nullptr)
    return make_error(
        Errc::usage, fmt::format("option 'bytes-at' has no effect on a tape that becomes {}", plan.to->name));
  return {};
}

Result<ConvertPlan> read_plan(const CommandLine& line) {
  ConvertPlan plan;
  if (line.tapes().size() > 1) return make_error(Errc::usage, "more than one input given");
  plan.in = line.tapes().front();
  plan.out = line.text("output").value_or("");
  if (plan.out.empty())
    return make_error(Errc::usage, "option 'output' is missing: -o OUT, what is to be made");
  if (line.has("overwrite")) plan.writer.on_existing = OnExisting::overwrite;
  if (Result<void> read = read_import_options(line, plan.import_options); !read) return read.error();
  const auto from = line.text("from");
  const bool is_dialect = from && from->ends_with(kDialectSuffix);
  if (is_dialect) plan.import_options.dialect = from;
  const Result<const Format*> read = is_dialect ? Result<const Format*>(find_format("dialect"))
                                     : from     ? named_format("from", *from, true)
                                                : found_format(plan.in);
  if (!read) return read.error();
  plan.from = *read;
  if (const auto to = line.text("to")) {
    const Result<const Format*> written = named_format("to", *to, false);
    if (!written) return written.error();
    plan.to = *written;
  } else {
    const Format* const by_name = detect_format({}, plan.out);
    if (by_name != nullptr && by_name->export_tape != nullptr) plan.to = by_name;
  }
  if (plan.to == nullptr && plan.from == nullptr)
    return make_error(Errc::usage, fmt::format("{} is a tape already; say by --to FORMAT what it shall be",
                                               in_quotes(plan.in)));
  if (Result<void> used = check_options(line, plan); !used) return used.error();
  if (plan.to == nullptr && plan.out == "-")
    return make_error(Errc::usage, "a tape is several files, which - is not; say --to FORMAT, or -o NAME");
  return plan;
}

int fail_convert(const ConvertPlan& plan, const Error& error, std::ostream& out, std::ostream& err) {
  return (plan.from == nullptr ? fail_verb : fail_without_tape)("convert", error, out, err);
}

void tell_import(const std::string& name, const ImportedTape& tape, const Format& from, std::ostream& out) {
  fmt::print(out, "{}: {} and {} in {} s, from {}\n", printable_line(name), counted(tape.blocks, "block"),
             counted(tape.events, "event"), seconds_number(to_us(tape.end)), from.name);
  for (const std::string& guess : tape.guesses) fmt::print(out, "  guessed  {}\n", printable_line(guess));
  for (const std::string& problem : tape.problems)
    fmt::print(out, "  problem  {}\n", printable_line(problem));
  if (tape.problem_count > tape.problems.size())
    fmt::print(out, "  problem  … and {} more\n", tape.problem_count - tape.problems.size());
}

Result<ImportedTape> import_to(const ConvertPlan& plan, const TapePaths& to, std::ostream& err) {
  Result<Evidence> evidence = Evidence::open(plan.in);
  if (!evidence) return evidence.error();
  Progress progress(err, "convert", evidence->size().value_or(0));
  ImportTape tape(to, plan.writer, plan.import_options, fs::path(evidence->name()).filename().string());
  const Result<std::optional<TapeTime>> end =
      plan.from->import_tape(*evidence, tape, [&](std::uint64_t bytes) { progress.at(bytes); });
  if (!end) return end.error();
  if (tape.empty() && !tape.is_sure())
    return make_error(Errc::not_a_tape,
                      fmt::format("{}: nothing in it is {}", in_quotes(evidence->name()), plan.from->name));
  return tape.finish(*end);
}

int export_from(const ConvertPlan& plan, Result<TapeReader> tape, const TapePaths& from, std::ostream& out,
                std::ostream& err) {
  const auto fail = [&](const Error& error) { return fail_convert(plan, error, out, err); };
  if (!tape) return fail(tape.error());
  if (const auto apart = check_report_apart(plan.out, from); !apart) return fail(apart.error());
  const bool overwrite = plan.writer.on_existing == OnExisting::overwrite;
  Result<NewFile> file = NewFile::create(plan.out, overwrite);
  if (!file) return fail(file.error());
  // Of a file that is no tape the tape in between is gone by now.
  for (const Result<void>& made : {file->made_of(from), file->made_of(plan.in)}) {
    if (!made) return fail(made.error());
  }
  Progress progress(err, "convert", size_of_tape(from));
  const auto told_bytes = [&](std::uint64_t bytes) { progress.at(bytes); };
  const auto lost = plan.to->export_at != nullptr
                        ? plan.to->export_at(*tape, *file, plan.import_options.bytes_at, told_bytes)
                        : plan.to->export_tape(*tape, *file, told_bytes);
  progress.clear();
  if (!lost) return fail(lost.error());
  if (Result<void> finished = file->finish(); !finished) return fail(finished.error());
  std::ostream& told = plan.out == "-" ? err : out;
  if (plan.out != "-") {
    fmt::print(told, "{}: {} of {}, {}\n", printable_line(plan.out), plan.to->name, printable_line(plan.in),
               counted(file->size(), "byte"));
  }
  for (const std::string& each : *lost) fmt::print(told, "  not in it  {}\n", printable_line(each));
  return exit_status::kPass;
}

// By a tape that nobody sees.
int convert_between(const ConvertPlan& plan, std::ostream& out, std::ostream& err) {
  PrivateFolder folder;
  const auto fail = [&](const Error& error) { return fail_convert(plan, error, out, err); };
  const Result<std::string> path = folder.make();
  if (!path) return fail(path.error());
  const Result<ImportedTape> made = import_to(plan, new_tape(*path + "/" + kBetween), err);
  if (!made) return fail(made.error());
  Result<TapeReader> tape = TapeReader::open(made->paths);
  for (const fs::path& file : {made->paths.read, made->paths.write, made->paths.events}) {
    std::error_code ignored;
    fs::remove(file, ignored);
  }
  tell_import(plan.in, *made, *plan.from, err);
  return export_from(plan, std::move(tape), made->paths, out, err);
}

}  // namespace

int run_convert(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kConvertHelp);
  line.value("from", "FORMAT", "what IN is")
      .value("to", "FORMAT", "what OUT is to be")
      .flag("formats", "lists the formats")
      .flag("swap", "what is read is what was written, and the other way round")
      .value("lead", "S", "seconds of silence before what comes first")
      .value("bytes-at", "BAUD", "what has no times gets those of a line of this speed, in bit/s")
      .value("device", "PATH", "which device, where there are several")
      .value("with", "FILE", "the second file, of what is kept in two")
      .value("output,o", "OUT", "the new tape or file")
      .flag("overwrite", "it replaces what has that name");
  line.takes_words();
  if (const auto done = line.parse(args, out, err)) return *done;
  if (line.has("formats")) return list_formats(out);
  if (line.words().empty()) return line.usage_error(err, "nothing is given to convert");
  const Result<ConvertPlan> plan = read_plan(line);
  if (!plan) return line.usage_error(err, plan.error().message);
  const auto fail = [&](const Error& error) { return fail_convert(*plan, error, out, err); };
  if (plan->from == nullptr) {
    const Result<TapePaths> tape = find_tape(plan->in);
    if (!tape) return line.usage_error(err, tape.error().message);
    return export_from(*plan, TapeReader::open(*tape), *tape, out, err);
  }
  if (plan->to == nullptr) {
    const Result<TapePaths> to = named_new_tape(plan->out);
    if (!to) return line.usage_error(err, "option 'output': " + to.error().message);
    if (const auto free = check_new_tape(*to, plan->writer); !free) return fail(free.error());
    const ModeOfSources mode(plan->in);
    const Result<ImportedTape> made = import_to(*plan, *to, err);
    if (!made) return fail(made.error());
    tell_import(made->paths.name(), *made, *plan->from, out);
    return exit_status::kPass;
  }
  return convert_between(*plan, out, err);
}

}  // namespace porttape
