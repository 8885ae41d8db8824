#pragma once

#include <cstdint>
#include <string>

#include "libport/base/result.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tools/command_line.hpp"

namespace porttape {

// The options -o NAME and --overwrite of a verb that makes a tape.
void add_new_tape_options(CommandLine& line);

struct NewTapeName {
  TapePaths paths;
  TapeWriterOptions writer;
};
// What they say; Errc::usage where there is no name, or it is taken or no tape can be made there.
Result<NewTapeName> read_new_tape(const CommandLine& line);
// The same, of a tape that goes by another name than was typed.
Result<void> check_new_tape(const TapePaths& paths, const TapeWriterOptions& options);

// The bytes of a tape's files, as far as they are known.
std::uint64_t size_of_tape(const TapePaths& tape);

// The only tape that was given. Errc::usage.
Result<TapePaths> the_tape(const CommandLine& line);

// Tells why a tape is not whole of which a verb has made another (TapeReader::half()).
void tell_half(std::string_view verb, std::string_view half, std::ostream& err);

// An error of a verb, told; its exit status. A damaged tape: `porttape recover` is named.
int fail_verb(std::string_view verb, const Error& error, std::ostream& out, std::ostream& err);
// The same of what is no tape, or was not read from one: recover is of no help.
int fail_without_tape(std::string_view verb, const Error& error, std::ostream& out, std::ostream& err);

}  // namespace porttape
