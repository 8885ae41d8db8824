#include "libport/pack/unpack.hpp"

#include <cerrno>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/tape/judgement.hpp"
#include "libport/tape/leftover.hpp"
#include "libport/tape/source_mode.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// A folder that goes away with all that was put into it, unless it was given its name.
class FolderSink final : public PackSink {
 public:
  // The folder and what is in it keep those permissions from the group and from others.
  static Result<FolderSink> create(const fs::path& folder, mode_t kept) {
    const auto cannot = [&](const std::string& why) {
      return make_error(Errc::usage, "cannot make the folder " + in_quotes(folder.string()) + ": " + why);
    };
    Result<TrustedName> place = find_trusted_name(folder.string());
    if (!place) return cannot(place.error().message);
    const int parent = place->folder.get();
    struct stat seen {};
    if (::fstatat(parent, place->name.c_str(), &seen, AT_SYMLINK_NOFOLLOW) == 0)
      return cannot("it is there already; give another -o DIR");
    if (errno != ENOENT) return cannot(errno_text(errno));
    Leftover hidden = Leftover::make_folder(parent, folder.parent_path().string(), "." + place->name + ".");
    if (hidden.path().empty()) return cannot("in its folder nothing can be made: " + errno_text(errno));
    const std::string name = fs::path(hidden.path()).filename().string();
    FolderSink sink(std::move(place->folder), folder, std::move(hidden), kept);
    sink.fd_.reset(::openat(parent, name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW));
    if (!sink.fd_) return cannot(errno_text(errno));
    return sink;
  }

  Result<void> begin_file(const std::string& name, std::uint64_t) override {
    constexpr int how = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
    constexpr mode_t mode = 0640;
    file_.reset(::openat(fd_.get(), name.c_str(), how, mode & ~kept_));
    if (!file_) return failed(name, errno);
    name_ = name;
    return {};
  }
  Result<void> write(ByteView bytes) override {
    while (!bytes.empty()) {
      const ssize_t done = ::write(file_.get(), bytes.data(), bytes.size());
      if (done < 0 && errno == EINTR) continue;
      if (done < 0) return failed(name_, errno);
      bytes = bytes.subspan(static_cast<std::size_t>(done));
    }
    return {};
  }
  Result<void> end_file() override {
    if (::fsync(file_.get()) != 0) return failed(name_, errno);
    if (::close(file_.release()) != 0) return failed(name_, errno);
    return {};
  }

  [[nodiscard]] fs::path path() const { return hidden_.path(); }
  Result<void> publish() {
    const mode_t mode = (kept_ & S_IRGRP) == 0 ? 0750 : 0700;
    const std::string from = path().filename().string();
    const std::string to = final_.filename().string();
    if (::fchmod(fd_.get(), mode) != 0 || ::fsync(fd_.get()) != 0 ||
        ::renameat2(parent_.get(), from.c_str(), parent_.get(), to.c_str(), RENAME_NOREPLACE) != 0)
      return make_error(Errc::io,
                        "cannot make the folder " + in_quotes(final_.string()) + ": " + errno_text(errno));
    hidden_.keep();
    return {};
  }

 private:
  FolderSink(UniqueFd parent, fs::path final, Leftover hidden, mode_t kept)
      : parent_(std::move(parent)), final_(std::move(final)), hidden_(std::move(hidden)), kept_(kept) {}

  [[nodiscard]] Error failed(const std::string& name, int error) const {
    return make_error(Errc::io,
                      "cannot write " + in_quotes((final_ / name).string()) + ": " + errno_text(error));
  }

  UniqueFd parent_;  // that it is made in
  fs::path final_;
  Leftover hidden_;  // what it is called until then
  mode_t kept_;
  UniqueFd fd_;
  UniqueFd file_;
  std::string name_;  // of the file that is written
};

Result<void> check_tapes(const PackManifest& manifest, const fs::path& folder) {
  for (const PackedTape& tape : manifest.tapes) {
    const Result<TapeSummary> summary = summarize(literal_tape((folder / tape.name).string()));
    const auto wrong = [&](const std::string& why) {
      return make_error(Errc::io, "its tape " + in_quotes(tape.name) + " is not what was packed: " + why);
    };
    if (!summary) return wrong("it cannot be read");
    const std::string id = summary->events.header ? summary->events.header->id.raw() : std::string();
    if (to_utf8(id) != tape.id.raw())
      return wrong("its id was " + tape.id.in_quotes() + ", and is " + in_quotes(id));
    const Judgement judgement = judge(*summary);
    if (to_string(judgement.verdict) == tape.verdict.raw()) continue;
    return wrong("it was " + tape.verdict.in_quotes() + ", and is " +
                 in_quotes(to_string(judgement.verdict)));
  }
  return {};
}

}  // namespace

Result<PackManifest> unpack(const fs::path& pack, const fs::path& folder, const PackLimits& limits) {
  fs::path to = folder;
  if (!to.has_filename()) to = to.parent_path();
  Result<std::unique_ptr<FileSource>> source = FileSource::open(pack);
  if (!source) return source.error();
  Result<FolderSink> sink = FolderSink::create(to, kept_from_others((*source)->fd()));
  if (!sink) return sink.error();
  const auto failed = [&](const Error& error) {
    return make_error(error.code, "pack " + in_quotes(pack.string()) + ": " + error.message);
  };
  Result<PackManifest> manifest = read_pack(**source, *sink, limits);
  if (!manifest) return failed(manifest.error());
  if (Result<void> right = check_tapes(*manifest, sink->path()); !right) return failed(right.error());
  if (Result<void> published = sink->publish(); !published) return published.error();
  return manifest;
}

}  // namespace porttape
