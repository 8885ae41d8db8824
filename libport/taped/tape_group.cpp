#include "libport/taped/tape_group.hpp"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "libport/loop/loop.hpp"
#include "libport/tape/event_file.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

std::optional<TapeZero> zero_of(const TapePaths& tape) {
  const std::optional<TapeHeader> header = header_of(tape);
  return header ? header->zero : std::nullopt;
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

// The tapes of the recording that `first` is of, without that of the connection `made`. One with a zero of
// its own is another recording, whatever its name.
std::vector<TapePaths> TapeGroup::older_group(const TapePaths& first, unsigned made) const {
  const std::vector<unsigned> connections = recorded_connections(first);
  if (std::ranges::find(connections, 1U) == connections.end()) return {};
  const std::optional<TapeZero> zero = zero_of(first);
  std::vector<TapePaths> older;
  for (const unsigned connection : connections) {
    const TapePaths tape = connection_tape(first, connection);
    const std::optional<TapeZero> own = zero_of(tape);
    const bool is_other = zero && own && *own != *zero;
    if (connection != made && !is_other && !is_being_written(tape)) older.push_back(tape);
  }
  return older;
}

Result<TapeWriter> TapeGroup::make(unsigned part, unsigned connection, const TapeHeader& header) {
  const std::lock_guard lock(mutex_);
  if (const auto known = names_.find(part); known != names_.end()) {
    const TapePaths tape = connection_tape(known->second, connection);
    return TapeWriter::create(tape, header, {.on_existing = OnExisting::refuse});
  }
  const bool by_number = part > 1 || on_existing_ == OnExisting::next;
  const TapePaths name = by_number ? free_name(part) : first_;
  if (!by_number) {
    if (Result<void> free = check_free(name); !free) return free.error();
  }
  const OnExisting existing = by_number ? OnExisting::refuse : on_existing_;
  const bool replaces = existing == OnExisting::overwrite;
  const std::vector<TapePaths> older = replaces ? older_group(name, connection) : std::vector<TapePaths>();
  Result<TapeWriter> writer =
      TapeWriter::create(connection_tape(name, connection), header, {.on_existing = existing});
  if (!writer) return writer;
  names_.emplace(part, name);
  for (const TapePaths& tape : older) {
    for (const auto& file : {tape.read, tape.write, tape.events}) {
      std::error_code told_when_it_is_in_the_way;
      std::filesystem::remove(file, told_when_it_is_in_the_way);
    }
  }
  return writer;
}

}  // namespace porttape
