#include "libport/tape/tape_set.hpp"

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/tape/signals_held.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_files.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

}  // namespace

Result<TapeSet> TapeSet::begin(const TapePaths& first, OnExisting on_existing) {
  const fs::path parent = first.read.has_parent_path() ? first.read.parent_path() : fs::path(".");
  const auto cannot = [&](const std::string& why) {
    return make_error(Errc::usage,
                      "cannot make tapes in the folder " + in_quotes(parent.string()) + ": " + why);
  };
  Result<TrustedName> place = find_trusted_name(first.read.string());
  if (!place) return cannot(place.error().message);
  Leftover folder =
      Leftover::make_folder(place->folder.get(), parent.string(), "." + first.file_name() + ".");
  if (folder.path().empty()) return cannot(errno_text(errno));
  return TapeSet(std::move(place->folder), std::move(folder), on_existing);
}

TapePaths TapeSet::hidden(const TapePaths& tape) const {
  return literal_tape((fs::path(folder_.path()) / tape.file_name()).string());
}

Result<void> TapeSet::check_free(const TapePaths& tape) const {
  std::error_code ignored;
  for (const fs::path& path : {tape.read, tape.write, tape.events}) {
    if (on_existing_ == OnExisting::refuse && fs::is_regular_file(fs::symlink_status(path, ignored)))
      return make_error(Errc::usage, "there is a tape " + in_quotes(tape.name()) +
                                         " already; take another name, or --overwrite to replace it");
  }
  return check_tape_files(tape, on_existing_);
}

Result<TapePaths> TapeSet::place(const TapePaths& tape) {
  if (Result<void> free = check_free(tape); !free) return free.error();
  tapes_.push_back(tape);
  return hidden(tape);
}

// The events first: who finds the blocks finds them, too.
Result<void> TapeSet::publish() {
  for (const TapePaths& tape : tapes_) {
    if (Result<void> free = check_free(tape); !free) return free;
    if (Result<void> kept = keep_from_others(hidden(tape), kept_from_others(tape)); !kept) return kept;
  }
  const SignalsHeld held;
  for (const TapePaths& tape : tapes_) {
    for (const fs::path* const file : {&tape.events, &tape.write, &tape.read}) {
      Result<void> moved = move(*file);
      if (moved) continue;
      undo();
      return moved;
    }
  }
  return {};
}

// Who takes a file's name away from it holds its lock.
Result<void> TapeSet::move(const fs::path& tape_file) {
  const auto failed = [&](int error) {
    return make_error(error == EEXIST ? Errc::usage : Errc::io,
                      "cannot make " + in_quotes(tape_file.string()) + ": " + errno_text(error));
  };
  const int folder = parent_.get();
  const std::string to = tape_file.filename().string();
  const std::string from = (fs::path(folder_.path()).filename() / to).string();
  constexpr int flags = O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
  UniqueFd existing(::openat(folder, to.c_str(), O_WRONLY | flags));
  // One that cannot be written has no lock of ours to take.
  const bool lockable = existing || errno != EACCES;
  if (!lockable) existing.reset(::openat(folder, to.c_str(), O_RDONLY | flags));
  if (!existing && errno != ENOENT) return failed(errno);
  const std::optional<FileIdentity> file = FileIdentity::at(folder, from);
  if (!file) return failed(errno);
  if (!existing) {
    if (const int error = move_to_free_name(folder, from, to); error != 0) return failed(error);
    moved_.push_back({from, to, *file});
    return {};
  }
  if (on_existing_ != OnExisting::overwrite) return failed(EEXIST);
  const TapeLock lock = lockable                           ? lock_tape_file(existing.get(), folder, to)
                        : is_being_written(existing.get()) ? TapeLock::taken
                                                           : TapeLock::held;
  if (lock == TapeLock::taken)
    return make_error(Errc::usage, in_quotes(tape_file.string()) + " is being written by a recording");
  if (lock == TapeLock::read)
    return make_error(Errc::usage, in_quotes(tape_file.string()) + " is locked by a program that reads it");
  if (lock == TapeLock::moved) return failed(EEXIST);
  const int error = exchange_names(folder, from, to);
  if (error == 0) {
    moved_.push_back({from, to, *file, true});
    // Whoever keeps to no lock may have put another file there meanwhile: undo() gives it its name again.
    return FileIdentity::at(folder, from) == FileIdentity::of(existing.get()) ? Result<void>()
                                                                              : Result<void>(failed(EEXIST));
  }
  const bool moved = ::renameat(folder, from.c_str(), folder, to.c_str()) == 0;
  return moved ? Result<void>() : Result<void>(failed(errno));
}

void TapeSet::undo() {
  for (; !moved_.empty(); moved_.pop_back()) {
    const Moved& last = moved_.back();
    if (!last.exchanged) {
      (void)remove_if_same(parent_.get(), last.to, last.file);
    } else if (FileIdentity::at(parent_.get(), last.to) == last.file) {
      (void)exchange_names(parent_.get(), last.from, last.to);
    }
  }
}

}  // namespace porttape
