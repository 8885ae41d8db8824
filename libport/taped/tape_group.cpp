#include "libport/taped/tape_group.hpp"

#include <filesystem>
#include <system_error>
#include <utility>

#include "libport/loop/loop.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {

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
  if (!part_) part_ = Part{1, at, tape_zero(at, Loop::now())};
  return *part_;
}

const TapeGroup::Part& TapeGroup::next(unsigned number, Instant at) {
  if (!part_ || part_->number <= number) part_ = Part{number + 1, at, tape_zero(at, Loop::now())};
  return *part_;
}

// A part takes a number that no part before it has, and no older group.
TapePaths TapeGroup::free_name(unsigned part) const {
  for (unsigned number = part;; ++number) {
    const TapePaths name = numbered_tape(first_, number);
    if (recorded_connections(name).empty()) return name;
  }
}

void TapeGroup::remove_older(const TapePaths& first, unsigned made) const {
  for (const unsigned connection : recorded_connections(first)) {
    const TapePaths tape = connection_tape(first, connection);
    if (connection == made || is_being_written(tape)) continue;
    for (const auto& file : {tape.read, tape.write, tape.events}) {
      std::error_code told_when_it_is_in_the_way;
      std::filesystem::remove(file, told_when_it_is_in_the_way);
    }
  }
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
  Result<TapeWriter> writer =
      TapeWriter::create(connection_tape(name, connection), header, {.on_existing = existing});
  if (!writer) return writer;
  names_.emplace(part, name);
  if (existing == OnExisting::overwrite) remove_older(name, connection);
  return writer;
}

}  // namespace porttape
