#include "libport/taped/tape_group.hpp"

#include <fcntl.h>
#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/loop/loop.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/source_mode.hpp"

namespace porttape {
namespace {

std::optional<TapeZero> zero_of(const TapePaths& tape) {
  const std::optional<TapeHeader> header = header_of(tape);
  return header ? header->zero : std::nullopt;
}

// The tapes of one recording have the same zero. Without it this program cannot tell whether they belong
// together.
bool is_one_recording(const TapePaths& first, const TapePaths& tape) {
  const std::optional<TapeZero> zero = zero_of(first);
  return zero && zero == zero_of(tape);
}

// What any tape of a recording keeps from others.
mode_t kept_by_group(const TapePaths& first) {
  mode_t kept = 0;
  for (const unsigned connection : recorded_connections(first))
    kept |= kept_from_others(connection_tape(first, connection));
  return kept;
}

}  // namespace

Result<void> TapeGroup::check() const {
  if (on_existing_ == OnExisting::next) return TapeWriter::check(first_, {.on_existing = on_existing_});
  if (Result<void> free = check_free(first_); !free) return free;
  return TapeWriter::check(first_, {.on_existing = on_existing_});
}

// Each tape of an older group must be free to be replaced, or not be there.
Result<void> TapeGroup::check_free(const TapePaths& first) const {
  for (const unsigned connection : recorded_connections(first)) {
    const TapePaths tape = connection_tape(first, connection);
    if (Result<void> free = TapeWriter::check(tape, {.on_existing = on_existing_}); !free) return free;
    if (on_existing_ == OnExisting::overwrite && connection > 1 && !is_one_recording(first, tape))
      return make_error(
          Errc::usage,
          fmt::format(
              "cannot make the tape: {} is not of the recording {}, which is to be replaced; move it, "
              "or take another name",
              in_quotes(tape.name()), in_quotes(first.name())));
  }
  return {};
}

const TapeGroup::Part& TapeGroup::begin(Instant at) {
  if (!part_) part_ = Part{1, at, tape_zero(at, *clock_)};
  return *part_;
}

const TapeGroup::Part& TapeGroup::next(unsigned number, Instant at) {
  if (!part_ || part_->number <= number) part_ = Part{number + 1, at, tape_zero(at, *clock_)};
  return *part_;
}

// A part takes a number that no part before it has, and no older group.
TapePaths TapeGroup::free_name(unsigned part) const {
  for (unsigned number = part;; ++number) {
    const TapePaths name = numbered_tape(first_, number);
    if (recorded_connections(name).empty()) return name;
  }
}

// The files of the recording that `first` is of, without those of the connection `made`.
std::vector<TapeGroup::OldFile> TapeGroup::older_group(const TapePaths& first, unsigned made) const {
  std::vector<OldFile> older;
  for (const unsigned connection : recorded_connections(first)) {
    const TapePaths tape = connection_tape(first, connection);
    if (connection == made) continue;
    for (const auto& path : {tape.read, tape.write, tape.events}) {
      if (const auto file = FileIdentity::at(AT_FDCWD, path)) older.push_back({path, *file});
    }
  }
  return older;
}

Result<TapeWriter> TapeGroup::make(unsigned part, unsigned connection, const TapeHeader& header) {
  const std::lock_guard lock(mutex_);
  if (const auto known = made_.find(part); known != made_.end()) {
    const TapePaths tape = connection_tape(known->second.name, connection);
    return TapeWriter::create(tape, header,
                              {.on_existing = OnExisting::refuse, .kept_from_others = known->second.kept});
  }
  const bool by_number = part > 1 || on_existing_ == OnExisting::next;
  const TapePaths name = by_number ? free_name(part) : first_;
  if (!by_number) {
    if (Result<void> free = check_free(name); !free) return free.error();
  }
  const OnExisting existing = by_number ? OnExisting::refuse : on_existing_;
  const bool replaces = existing == OnExisting::overwrite;
  const std::vector<OldFile> older = replaces ? older_group(name, connection) : std::vector<OldFile>();
  const mode_t kept = replaces ? kept_by_group(name) : 0;
  Result<TapeWriter> writer = TapeWriter::create(connection_tape(name, connection), header,
                                                 {.on_existing = existing, .kept_from_others = kept});
  if (!writer) return writer;
  made_.emplace(part, Made{name, kept});
  // A file that cannot be removed is reported when its name is needed.
  for (const OldFile& old : older) (void)remove_if_same(AT_FDCWD, old.path, old.file);
  return writer;
}

}  // namespace porttape
