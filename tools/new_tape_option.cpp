#include "tools/new_tape_option.hpp"

#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <system_error>

#include "libport/base/printable.hpp"

namespace porttape {

namespace fs = std::filesystem;

void add_new_tape_options(CommandLine& line) {
  line.value("output,o", "NAME", "the new tape").flag("overwrite", "it replaces one of that name");
}

Result<NewTapeName> read_new_tape(const CommandLine& line) {
  const auto name = line.text("output");
  if (!name)
    return make_error(Errc::usage, "option 'output' is missing: -o NAME, the tape that is to be made");
  if (*name == "-")
    return make_error(Errc::usage, "option 'output': a tape is several files, which - is not; give -o NAME");
  const Result<TapePaths> paths = named_new_tape(*name);
  if (!paths) return make_error(Errc::usage, "option 'output': " + paths.error().message);
  NewTapeName tape{*paths, {}};
  if (line.has("overwrite")) tape.writer.on_existing = OnExisting::overwrite;
  return tape;
}

Result<void> check_new_tape(const TapePaths& paths, const TapeWriterOptions& options) {
  std::error_code ignored;
  for (const fs::path& path : {paths.read, paths.write, paths.events}) {
    const bool taken = fs::is_regular_file(fs::symlink_status(path, ignored));
    if (taken && options.on_existing == OnExisting::refuse)
      return make_error(Errc::usage, fmt::format("there is a tape {} already; give another -o NAME, or "
                                                 "--overwrite to replace it",
                                                 in_quotes(paths.name())));
  }
  return TapeWriter::check(paths, options);
}

std::uint64_t size_of_tape(const TapePaths& tape) {
  std::uint64_t bytes = 0;
  for (const fs::path& path : {tape.read, tape.write, tape.events}) {
    std::error_code error;
    const std::uintmax_t size = fs::file_size(path, error);
    if (!error) bytes += size;
  }
  return bytes;
}

Result<TapePaths> the_tape(const CommandLine& line) {
  if (line.tapes().size() > 1) return make_error(Errc::usage, "more than one tape given");
  return find_tape(line.tapes().front());
}

void tell_half(std::string_view verb, std::string_view half, std::ostream& err) {
  fmt::print(err, "porttape {}: warning: {}; what was made has no end therefore\n", verb,
             printable_line(half));
}

int fail_verb(std::string_view verb, const Error& error, std::ostream& out, std::ostream& err) {
  if (error.code != Errc::damaged_tape || verb == "recover") return fail_without_tape(verb, error, out, err);
  return fail_without_tape(
      verb, {error.code, error.message + "; porttape recover TAPE -o NAME keeps what is sound of it"}, out,
      err);
}

int fail_without_tape(std::string_view verb, const Error& error, std::ostream& out, std::ostream& err) {
  out.flush();
  err << fmt::format("porttape {}: {}\n", verb, printable_lines(error.message));
  return exit_status_of(error.code);
}

}  // namespace porttape
