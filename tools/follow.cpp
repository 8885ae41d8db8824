#include "tools/follow.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <memory>
#include <poll.h>
#include <string_view>
#include <sys/inotify.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>

#include "libport/tape/event_file.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// Where inotify is refused.
constexpr std::chrono::milliseconds kLook{100};
// How often the next part of a tape is looked for.
constexpr std::chrono::milliseconds kPartLook{50};

// Without what it ends with, if that is `begin` and a number: "laser" of laser.2 for ".".
fs::path without_number(const fs::path& name, std::string_view begin) {
  const std::string end = name.extension().string();
  const bool numbered = end.starts_with(begin) && end.size() > begin.size() &&
                        end.find_first_not_of("0123456789", begin.size()) == std::string::npos;
  return numbered ? name.stem() : name;
}

// "laser" of laser.log, laser.2.log, and of several connections' laser.c2.log and laser.2.c2.log.
std::string stem_of(const TapePaths& tape) {
  fs::path name = fs::path(tape.file_name());
  if (name.extension() == ".log") name = name.stem();
  return without_number(without_number(name, ".c"), ".").string();
}

std::optional<std::string> part_after(const TapePaths& tape, const std::string& id) {
  const fs::path folder = tape.events.has_parent_path() ? tape.events.parent_path() : fs::path(".");
  const std::string begin = stem_of(tape) + ".";
  std::error_code unreadable;
  for (fs::directory_iterator entry(folder, unreadable), end; !unreadable && entry != end;
       entry.increment(unreadable)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with(begin) || !name.ends_with('e')) continue;
    const auto header = header_of({.read = {}, .write = {}, .events = entry->path()});
    if (header && header->previous && header->previous->id.raw() == id)
      return (tape.events.parent_path() / name.substr(0, name.size() - 1)).string();
  }
  return std::nullopt;
}

}  // namespace

TapeGrowth::TapeGrowth(const TapePaths& tape, int out)
    : inotify_(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC)), out_(out) {
  if (!inotify_) return;
  for (const fs::path& file : {tape.read, tape.write, tape.events}) {
    const int watch = ::inotify_add_watch(inotify_.get(), file.c_str(), IN_MODIFY | IN_CLOSE_WRITE);
    if (watch >= 0 || errno == ENOENT) continue;
    inotify_.reset();
    return;
  }
}

TapeGrowth::News TapeGrowth::wait() const {
  std::array<pollfd, 2> watched = {pollfd{inotify_.get(), POLLIN, 0}, pollfd{out_, 0, 0}};
  const Nanos limit = inotify_ ? Nanos(kQuiet) : Nanos(kLook);
  const int ready =
      ::poll(watched.data(), watched.size(),
             static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(limit).count()));
  if (ready > 0 && (watched[1].revents & (POLLERR | POLLHUP)) != 0) return News::no_reader;
  if (ready <= 0 || (watched[0].revents & POLLIN) == 0) return News::quiet;
  std::this_thread::sleep_for(kSettle);
  std::array<char, 4096> events;
  while (::read(inotify_.get(), events.data(), events.size()) > 0) {
  }
  return News::grown;
}

std::optional<std::string> next_part(const TapePaths& tape, const std::string& id, Nanos limit) {
  const Instant end = verb_clock().now() + limit;
  for (;;) {
    if (auto part = part_after(tape, id)) return part;
    if (verb_clock().now() >= end) return std::nullopt;
    std::this_thread::sleep_for(kPartLook);
  }
}

}  // namespace porttape
