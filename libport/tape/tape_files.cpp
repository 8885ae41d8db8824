#include "libport/tape/tape_files.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

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

Result<void> remove_old(const Places& places) {
  for (const Place& place : places) {
    if (!place.exists) continue;
    if (::unlinkat(place.folder.get(), place.file().c_str(), 0) != 0 && errno != ENOENT) {
      return make_error(Errc::io, "cannot replace " + place.path.string() + ": " + errno_text(errno));
    }
  }
  return {};
}

}  // namespace

Result<void> check_tape_files(const TapePaths& paths, bool overwrite) {
  const auto places = look_at(paths, overwrite);
  if (!places) return places.error();
  return {};
}

Result<TapeSinks> create_tape_files(const TapePaths& paths, bool overwrite) {
  const auto places = look_at(paths, overwrite);
  if (!places) return places.error();
  if (const auto removed = remove_old(*places); !removed) return removed.error();
  std::array<std::unique_ptr<TapeSink>, 3> sinks;
  for (std::size_t i = 0; i < sinks.size(); ++i) {
    const Place& place = places->at(i);
    int error = 0;
    sinks.at(i) = FileSink::create(place.folder.get(), place.file(), error);
    if (sinks.at(i)) continue;
    for (std::size_t made = 0; made < i; ++made) {
      ::unlinkat(places->at(made).folder.get(), places->at(made).file().c_str(), 0);
    }
    return cannot_make(place, error);
  }
  return TapeSinks{std::move(sinks[0]), std::move(sinks[1]), std::move(sinks[2])};
}

}  // namespace porttape
