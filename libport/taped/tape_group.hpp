#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <sys/types.h>
#include <vector>

#include "libport/base/own_name.hpp"
#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// The tapes of the connections of one driver's port: `laser.log`, `laser.c2.log`, …, by the order in which
// the connections came, with one zero. A rotation begins the next part of all of them at once: `laser.2.log`,
// `laser.2.c2.log`, ….
//
// A group never mixes with the files of an older one: with OnExisting::refuse none of the names may be taken,
// with `next` a part takes the first number of which none is, with `overwrite` the older group's tapes are
// removed, all of them, once the first new one has been made; each new one keeps from the group of users and
// from others what any of those did. A tape whose zero differs from the first one's,
// or that has none, does not belong to that group: if it has one of the names, check() and make() fail and
// leave all files as they are.
//
// begin() and next() are the loop thread's; make() may be called from any thread and waits for the disk.
class TapeGroup {
 public:
  // What the tapes that begin together have in common.
  struct Part {
    unsigned number = 0;  // 1, 2, …
    Instant zero{};
    TapeZero header_zero;
  };

  // `clock`, the connections' own, outlives it.
  TapeGroup(TapePaths first, OnExisting on_existing, const Clock& clock)
      : first_(std::move(first)), on_existing_(on_existing), clock_(&clock) {}

  // Whether the group can be made. Makes nothing. Errc::usage.
  [[nodiscard]] Result<void> check() const;

  // The part for a connection that comes now; the first one's time is the zero.
  const Part& begin(Instant at);
  // The part after the one with this number: begins it now, where nobody else has.
  const Part& next(unsigned number, Instant at);
  // The same for whoever comes, where a connection has come yet.
  void rotate(Instant at) {
    if (part_) next(part_->number, at);
  }

  [[nodiscard]] TapePaths tape_of(unsigned connection) const { return connection_tape(first_, connection); }
  // Makes a connection's tape of that part, as TapeWriter::create().
  Result<TapeWriter> make(unsigned part, unsigned connection, const TapeHeader& header);

 private:
  struct OldFile {
    std::filesystem::path path;
    FileIdentity file;
  };
  [[nodiscard]] TapePaths free_name(unsigned part) const;
  [[nodiscard]] Result<void> check_free(const TapePaths& first) const;
  [[nodiscard]] std::vector<OldFile> older_group(const TapePaths& first, unsigned made) const;

  const TapePaths first_;
  const OnExisting on_existing_;
  const Clock* const clock_;
  std::optional<Part> part_;  // the latest
  std::mutex mutex_;
  struct Made {
    TapePaths name;
    mode_t kept = 0;  // from others, by the older group that it replaces
  };
  std::map<unsigned, Made> made_;  // the parts that a tape was made of
};

}  // namespace porttape
