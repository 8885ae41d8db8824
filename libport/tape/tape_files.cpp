#include "libport/tape/tape_files.hpp"

#include <atomic>
#include <cerrno>
#include <fcntl.h>
#include <optional>
#include <string>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// One file to be made, by its folder's descriptor, so that all steps are about the same folder.
struct Place {
  fs::path path;
  UniqueFd folder;
  bool exists = false;
  UniqueFd existing;  // the file that is to be replaced, locked

  [[nodiscard]] fs::path file() const { return path.filename(); }
};

Error refuse(const std::string& what) { return make_error(Errc::usage, "cannot make the tape: " + what); }

Error is_live(const fs::path& path) {
  return refuse(
      in_quotes(path.string()) +
      " is being written by another recording, which cannot be replaced; end that one first, or take "
      "another name");
}

Error is_read_locked(const fs::path& path) {
  return refuse(in_quotes(path.string()) +
                " is locked by a program that reads it, not by a recording; end that program (lslocks shows "
                "it), or take another name");
}

Result<Place> look_at_folder(const fs::path& path) {
  Place place;
  place.path = path;
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!path.has_filename()) return refuse(in_quotes(path.string()) + " names no file");
  Result<TrustedName> found = find_trusted_name(path.string());
  if (!found) return refuse(in_quotes(path.string()) + ": " + found.error().message);
  place.folder = std::move(found->folder);
  if (::faccessat(place.folder.get(), ".", W_OK | X_OK, AT_EACCESS) != 0) {
    return refuse("the folder " + in_quotes(folder.string()) + " is not writable: " + errno_text(errno));
  }
  return place;
}

Result<Place> look_at(const fs::path& path, OnExisting on_existing) {
  auto place = look_at_folder(path);
  if (!place || on_existing == OnExisting::next) return place;
  struct stat status {};
  if (::fstatat(place->folder.get(), place->file().c_str(), &status, AT_SYMLINK_NOFOLLOW) != 0) {
    if (errno == ENOENT) return place;
    return refuse(in_quotes(path.string()) + ": " + errno_text(errno));
  }
  place->exists = true;
  if (S_ISLNK(status.st_mode)) {
    return refuse(in_quotes(path.string()) +
                  " is a symbolic link, which is never written through; remove it or take another name");
  }
  if (!S_ISREG(status.st_mode))
    return refuse(in_quotes(path.string()) + " is not a regular file; take another name");
  if (is_being_written(path)) return is_live(path);
  if (on_existing == OnExisting::overwrite) return place;
  return refuse(
      in_quotes(path.string()) +
      " exists; take another name, or --on-existing next for a numbered one, or --overwrite to replace "
      "the tape");
}

using Places = std::array<Place, 3>;

Result<Places> look_at(const TapePaths& paths, OnExisting on_existing) {
  Places places;
  std::size_t i = 0;
  for (const fs::path* path : {&paths.read, &paths.write, &paths.events}) {
    auto place = look_at(*path, on_existing);
    if (!place) return place.error();
    places.at(i++) = std::move(*place);
  }
  return places;
}

// Locks the file that is to be replaced. False: there is another one under the name by now, or none.
Result<bool> lock_existing(Place& place) {
  place.existing.reset(::openat(place.folder.get(), place.file().c_str(),
                                O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  if (!place.existing) {
    if (errno == ENOENT) return false;
    return refuse(in_quotes(place.path.string()) + " cannot be locked to be replaced: " + errno_text(errno) +
                  "; remove it or take another name");
  }
  switch (lock_tape_file(place.existing.get(), place.folder.get(), place.file())) {
    case TapeLock::held:
      return true;
    case TapeLock::moved:
      return false;
    case TapeLock::taken:
      return is_live(place.path);
    case TapeLock::read:
      return is_read_locked(place.path);
    case TapeLock::failed:
      break;
  }
  return make_error(Errc::io, "cannot lock " + in_quotes(place.path.string()) + ": " + errno_text(errno));
}

// The place, with the lock of the file that stands there. It may change while it is looked at, by other
// recorders that replace it; each of them holds the lock for long, so that few rounds are enough.
Result<Place> take_place(const fs::path& path, OnExisting on_existing) {
  constexpr int kRounds = 100;
  for (int round = 0; round < kRounds; ++round) {
    auto place = look_at(path, on_existing);
    if (!place || !place->exists) return place;
    const auto locked = lock_existing(*place);
    if (!locked) return locked.error();
    if (*locked) return place;
  }
  return is_live(path);
}

// Whatever else is wrong with a place is told when a file is made there.
bool is_taken(const TapePaths& paths) {
  std::error_code ignored;
  return fs::exists(fs::symlink_status(paths.read, ignored)) ||
         fs::exists(fs::symlink_status(paths.write, ignored)) ||
         fs::exists(fs::symlink_status(paths.events, ignored));
}

Error cannot_make(const Place& place, int error) {
  if (error == EEXIST)
    return refuse(in_quotes(place.path.string()) + " has come into being meanwhile; take another name");
  return make_error(Errc::io, "cannot make " + in_quotes(place.path.string()) + ": " + errno_text(error));
}

// Beside the file it is to replace, and not to be taken for a tape.
fs::path replacement_name(const fs::path& name) {
  static std::atomic<unsigned> count{0};
  return "." + name.string() + ".new-" + std::to_string(::getpid()) + "-" + std::to_string(count++);
}

}  // namespace

Result<void> check_tape_files(const TapePaths& paths, OnExisting on_existing) {
  const auto places = look_at(paths, on_existing);
  if (!places) return places.error();
  return {};
}

struct NewTapeFiles::Entry {
  Place place;
  fs::path name;  // in the folder; the final one unless a file is to be replaced; none yet: empty
  std::optional<FileIdentity> made = {};  // under that name, and to be removed unless all is well
  const FileSink* unnamed = nullptr;

  std::unique_ptr<TapeSink> make(Appear appear, mode_t kept, int& error);
  [[nodiscard]] int publish();
};

std::unique_ptr<TapeSink> NewTapeFiles::Entry::make(Appear appear, mode_t kept, int& error) {
  const int folder = place.folder.get();
  if (appear == Appear::when_published) {
    auto file = FileSink::create_unnamed(folder, error, kept);
    unnamed = file.get();
    if (file || error != EOPNOTSUPP) return file;
  }
  const bool final = appear == Appear::at_once && !place.exists;
  name = final ? place.file() : replacement_name(place.file());
  auto file = FileSink::create(folder, name, error, kept);
  if (file) made = FileIdentity::at(folder, name);
  return file;
}

// 0 or the errno; EEXIST: the name has been taken meanwhile.
int NewTapeFiles::Entry::publish() {
  const int folder = place.folder.get();
  const fs::path final = place.file();
  if (unnamed != nullptr) {
    const fs::path first = place.exists ? replacement_name(final) : final;
    if (const int error = unnamed->link(folder, first); error != 0) return error;
    name = first;
    made = FileIdentity::at(folder, name);
  }
  if (name == final) return 0;
  const std::optional<FileIdentity> old =
      place.exists ? FileIdentity::of(place.existing.get()) : std::nullopt;
  const int error = move_over(folder, name, final, old);
  if (error == 0) name = final;
  return error;
}

NewTapeFiles::NewTapeFiles() : entries_(std::make_unique<Entries>()) {}
NewTapeFiles::NewTapeFiles(NewTapeFiles&&) noexcept = default;

NewTapeFiles::~NewTapeFiles() { discard(); }

void NewTapeFiles::discard() {
  if (!entries_) return;
  for (Entry& entry : *entries_) {
    if (const auto made = std::exchange(entry.made, std::nullopt))
      (void)remove_if_same(entry.place.folder.get(), entry.name, *made);
  }
}

Result<NewTapeFiles> NewTapeFiles::make(const TapePaths& paths, const TapeWriterOptions& options,
                                        Appear appear) {
  const mode_t kept = options.kept_from_others;
  if (options.on_existing != OnExisting::next) return make_at(paths, options.on_existing, appear, kept);
  for (unsigned number = options.first_number;; ++number) {
    const TapePaths candidate = numbered_tape(paths, number);
    if (is_taken(candidate)) continue;
    auto files = make_at(candidate, OnExisting::refuse, appear, kept);
    if (files || !is_taken(candidate)) return files;  // else somebody was faster
  }
}

Result<NewTapeFiles> NewTapeFiles::make_at(const TapePaths& paths, OnExisting on_existing, Appear appear,
                                           mode_t kept) {
  std::array<std::unique_ptr<TapeSink>, 3> sinks;  // outlive `files`: what is removed is still locked
  NewTapeFiles files;
  files.paths = paths;
  const std::array<const fs::path*, 3> all{&paths.read, &paths.write, &paths.events};
  for (std::size_t i = 0; i < all.size(); ++i) {
    auto place = take_place(*all.at(i), on_existing);
    if (!place) return place.error();
    if (place->existing) kept |= kept_from_others(place->existing.get());
    files.entries_->at(i).place = std::move(*place);
  }
  for (std::size_t i = 0; i < sinks.size(); ++i) {
    Entry& entry = files.entries_->at(i);
    int error = 0;
    sinks.at(i) = entry.make(appear, kept, error);
    if (!sinks.at(i)) return cannot_make(entry.place, error);
  }
  files.sinks = {std::move(sinks[0]), std::move(sinks[1]), std::move(sinks[2])};
  return files;
}

// The events first: who finds the blocks finds them, too.
Result<void> NewTapeFiles::publish() {
  for (std::size_t i = entries_->size(); i-- > 0;) {
    Entry& entry = entries_->at(i);
    const int error = entry.publish();
    if (error == 0) continue;
    // What stood there before is replaced for good.
    for (Entry& other : *entries_) {
      if (other.place.exists && other.name == other.place.file()) other.made.reset();
    }
    discard();
    if (error == EEXIST) return cannot_make(entry.place, error);
    const std::string what = entry.place.exists ? "cannot replace " : "cannot make ";
    return make_error(Errc::io, what + in_quotes(entry.place.path.string()) + ": " + errno_text(error));
  }
  for (Entry& entry : *entries_) entry.made.reset();  // they stay
  return {};
}

}  // namespace porttape
