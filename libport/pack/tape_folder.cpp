#include "libport/pack/tape_folder.hpp"

#include <cerrno>
#include <fcntl.h>
#include <string>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;  // as the kernel follows
constexpr int kAsFolder = O_PATH | O_DIRECTORY | O_CLOEXEC;

}  // namespace

Result<TapeFolder> TapeFolder::open(const TapePaths& tape) {
  const fs::path folder = tape.read.has_parent_path() ? tape.read.parent_path() : fs::path(".");
  UniqueFd fd(::open(folder.c_str(), kAsFolder));
  if (!fd)
    return make_error(Errc::usage, "the folder " + in_quotes(folder.string()) + ": " + errno_text(errno));
  return TapeFolder(std::move(fd));
}

// Whether what a link there leads to is a name of this folder.
bool TapeFolder::holds(const fs::path& target) const {
  if (!target.has_parent_path()) return true;
  const UniqueFd parent(::openat(folder_.get(), target.parent_path().c_str(), kAsFolder));
  return parent && FileIdentity::of(parent.get()) == FileIdentity::of(folder_.get());
}

Result<std::unique_ptr<FileSource>> TapeFolder::open_file(const fs::path& path) const {
  std::string name = path.filename().string();
  for (int links = 0; links <= kMostLinks; ++links) {
    const fs::path target = link_text(folder_.get(), name);
    if (target.empty()) {
      if (!FileIdentity::at(folder_.get(), name) && errno == ENOENT) return std::unique_ptr<FileSource>();
      return FileSource::open_in(folder_.get(), name, path.string());
    }
    if (!holds(target))
      return make_error(Errc::usage, in_quotes(path.string()) +
                                         " is a link that leads out of its folder, to " +
                                         in_quotes(target.string()) +
                                         "; if that belongs to the tape, put a copy in the link's place");
    name = target.filename().string();
  }
  return make_error(Errc::usage, "cannot read " + path.string() + ": " + errno_text(ELOOP));
}

}  // namespace porttape
