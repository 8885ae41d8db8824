#include "libport/tape/tape_files.hpp"

#include <atomic>
#include <cerrno>
#include <fcntl.h>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace porttape {
namespace {

namespace fs = std::filesystem;

// One file to be made, by its folder's descriptor, so that both steps are about the same folder.
struct Place {
  fs::path path;
  UniqueFd folder;
  bool exists = false;

  [[nodiscard]] fs::path file() const { return path.filename(); }
};

Error refuse(const std::string& what) { return make_error(Errc::usage, "cannot make the tape: " + what); }

Result<Place> look_at(const fs::path& path, bool overwrite) {
  Place place;
  place.path = path;
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!path.has_filename()) return refuse("'" + path.string() + "' names no file");
  place.folder.reset(::open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  if (!place.folder) return refuse("the folder " + folder.string() + ": " + errno_text(errno));
  if (::faccessat(place.folder.get(), ".", W_OK | X_OK, AT_EACCESS) != 0) {
    return refuse("the folder " + folder.string() + " is not writable: " + errno_text(errno));
  }
  struct stat status {};
  if (::fstatat(place.folder.get(), place.file().c_str(), &status, AT_SYMLINK_NOFOLLOW) != 0) {
    if (errno == ENOENT) return place;
    return refuse(path.string() + ": " + errno_text(errno));
  }
  place.exists = true;
  if (S_ISLNK(status.st_mode)) {
    return refuse(path.string() +
                  " is a symbolic link, which is never written through; remove it or take another name");
  }
  if (!S_ISREG(status.st_mode)) return refuse(path.string() + " is not a regular file; take another name");
  if (!overwrite)
    return refuse(path.string() + " exists; take another name, or --overwrite to replace the tape");
  return place;
}

using Places = std::array<Place, 3>;

Result<Places> look_at(const TapePaths& paths, bool overwrite) {
  Places places;
  std::size_t i = 0;
  for (const fs::path* path : {&paths.read, &paths.write, &paths.events}) {
    auto place = look_at(*path, overwrite);
    if (!place) return place.error();
    places.at(i++) = std::move(*place);
  }
  return places;
}

Error cannot_make(const Place& place, int error) {
  if (error == EEXIST)
    return refuse(place.path.string() + " has come into being meanwhile; take another name");
  return make_error(Errc::io, "cannot make " + place.path.string() + ": " + errno_text(error));
}

// Beside the file it is to replace, and not to be taken for a tape.
fs::path replacement_name(const fs::path& name) {
  static std::atomic<unsigned> count{0};
  return "." + name.string() + ".new-" + std::to_string(::getpid()) + "-" + std::to_string(count++);
}

}  // namespace

Result<void> check_tape_files(const TapePaths& paths, bool overwrite) {
  const auto places = look_at(paths, overwrite);
  if (!places) return places.error();
  return {};
}

struct NewTapeFiles::Entry {
  Place place;
  fs::path name;  // in the folder; the final one unless a file is to be replaced
  bool made = false;
};

NewTapeFiles::NewTapeFiles() : entries_(std::make_unique<Entries>()) {}
NewTapeFiles::NewTapeFiles(NewTapeFiles&&) noexcept = default;

NewTapeFiles::~NewTapeFiles() {
  if (!entries_) return;
  for (const Entry& entry : *entries_) {
    if (entry.made) ::unlinkat(entry.place.folder.get(), entry.name.c_str(), 0);
  }
}

Result<NewTapeFiles> NewTapeFiles::make(const TapePaths& paths, bool overwrite) {
  auto places = look_at(paths, overwrite);
  if (!places) return places.error();
  NewTapeFiles files;
  std::array<std::unique_ptr<TapeSink>, 3> sinks;
  for (std::size_t i = 0; i < sinks.size(); ++i) {
    Entry& entry = files.entries_->at(i);
    entry.place = std::move(places->at(i));
    entry.name = entry.place.exists ? replacement_name(entry.place.file()) : entry.place.file();
    int error = 0;
    sinks.at(i) = FileSink::create(entry.place.folder.get(), entry.name, error);
    if (!sinks.at(i)) return cannot_make(entry.place, error);
    entry.made = true;
  }
  files.sinks = {std::move(sinks[0]), std::move(sinks[1]), std::move(sinks[2])};
  return files;
}

Result<void> NewTapeFiles::publish() {
  for (Entry& entry : *entries_) {
    const int folder = entry.place.folder.get();
    const fs::path final_name = entry.place.file();
    if (entry.name != final_name && ::renameat(folder, entry.name.c_str(), folder, final_name.c_str()) != 0) {
      return make_error(Errc::io, "cannot replace " + entry.place.path.string() + ": " + errno_text(errno));
    }
    entry.made = false;  // it stays
  }
  return {};
}

}  // namespace porttape
