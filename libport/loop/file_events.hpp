#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// Tells when programs open and close files and when names in folders change, for all ports of a loop by one
// inotify descriptor, which is there while anything is watched.
//
// The kernel merges an event with the one before it when they are equal, which would hide that a file was
// opened twice. So the folder of a file whose opens count is watched too: each open and close is then two
// different events in turn, and none is merged (`exact`).
//
// Where inotify is refused (limits) the watches of files are told `unknown` every kPoll, and all are once
// when the kernel had no room for events: then the one who watches has to look for himself.
// Loop thread only.
class FileEvents {
 public:
  enum class Event : std::uint8_t { opened, closed, changed, unknown };
  static constexpr Nanos kPoll = std::chrono::milliseconds(100);
  static constexpr Nanos kQuickPoll = std::chrono::microseconds(250);

 private:
  struct Entry;

 public:
  // Ends when it is destroyed, also from within its own callback.
  class Watch {
   public:
    explicit Watch(std::shared_ptr<Entry> entry);
    ~Watch();
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

    // Called from the loop when there is something to take.
    void on_event(std::function<void()> callback);
    // What has happened since the last call, in order.
    std::vector<Event> take();
    // Whether each open and close is told.
    [[nodiscard]] bool exact() const;
    // False: the file is not there, or inotify is refused.
    [[nodiscard]] bool is_watching() const;
    // Runs `visit`, which opens and closes the file itself; that is not told.
    void unnoticed(const std::function<void()>& visit);

   private:
    std::shared_ptr<Entry> entry_;
  };

  explicit FileEvents(Loop& loop);
  ~FileEvents();
  FileEvents(const FileEvents&) = delete;
  FileEvents& operator=(const FileEvents&) = delete;

  // Tells `opened` and `closed` of one file.
  std::unique_ptr<Watch> watch_file(const std::string& path);
  // Tells `closed` of one file, where the number of opens and closes does not matter: its folder, in which
  // much more may be opened, is not watched.
  std::unique_ptr<Watch> watch_closes(const std::string& path);
  // Tells `changed` when that name appears in a folder, leaves it or gets other permissions, and when the
  // folder itself goes. Silent where refused.
  std::unique_ptr<Watch> watch_folder(const std::string& path, const std::string& name);

  // For a loop that may end soon: no inotify before so much time has passed, since the kernel takes some 15
  // ms to take it back. Until then the watches of files are told `unknown` every kQuickPoll. Call before the
  // first watch.
  void begin_after(Nanos delay);

  // As if the kernel refused inotify from now on, or had lost events. For tests.
  void refuse() { refused_ = true; }
  void lose();

  // Why inotify is refused, for the log: the first time it is asked for, else empty.
  std::string take_trouble();

 private:
  void add(const std::shared_ptr<Entry>& entry);
  void watch_parent(Entry& entry);
  void remove(const std::shared_ptr<Entry>& entry);
  bool start();
  void watch(const std::shared_ptr<Entry>& entry);
  void refused(const std::string& path, int error_number);
  void gather();
  void distribute(int wd, std::uint32_t mask, std::string_view name);
  void pend(const std::shared_ptr<Entry>& entry, Event event);
  void wake();
  void wake_soon();
  void on_poll();

  Loop* loop_;
  UniqueFd inotify_;
  std::unique_ptr<FdWatch> watch_;
  Timer poll_timer_;
  std::vector<std::shared_ptr<Entry>> entries_;
  std::multimap<int, std::shared_ptr<Entry>> by_number_;  // of the kernel's watch
  std::map<int, int> parents_;                            // watches of folders that keep others exact: users
  std::vector<std::shared_ptr<Entry>> pending_;           // told something, not woken yet
  std::string trouble_;
  bool trouble_told_ = false;
  bool refused_ = false;
  Instant begins_{};
};

}  // namespace porttape
