#include "libport/loop/file_events.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <sys/inotify.h>
#include <sys/syscall.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/loop.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using Event = FileEvents::Event;
using Events = std::vector<Event>;
using std::chrono::microseconds;
using std::chrono::milliseconds;

class FileEventsTest : public testing::Test {
 protected:
  FileEventsTest() { std::ofstream(file) << "x"; }
  void open_and_close(int times = 1) const {
    for (int n = 0; n < times; ++n) UniqueFd(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  }
  std::unique_ptr<FileEvents::Watch> watch_file() {
    auto watch = events().watch_file(file);
    watch->on_event([this] { ++calls; });
    return watch;
  }
  FileEvents& events() { return loop.file_events(); }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }
  // The kernel's events are no matter of the clock.
  void until_called() {
    while (calls == 0) loop.run_one();
  }

  test::TempDir dir;
  std::string file = (dir.path() / "file").string();
  ManualClock clock;
  Loop loop{clock};
  int calls = 0;
};

TEST_F(FileEventsTest, EachOpenAndEachCloseIsTold) {
  const auto watch = watch_file();
  EXPECT_TRUE(watch->is_watching());
  EXPECT_TRUE(watch->exact());
  open_and_close(3);
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed, Event::opened, Event::closed, Event::opened,
                                   Event::closed}));
  EXPECT_EQ(watch->take(), Events{});
}

TEST_F(FileEventsTest, ClosesAloneAreToldWithoutAWatchOfTheFolder) {
  const auto watch = events().watch_closes(file);
  EXPECT_TRUE(watch->is_watching());
  EXPECT_FALSE(watch->exact());
  open_and_close();
  EXPECT_EQ(watch->take(), Events{Event::closed});
  events().lose();
  EXPECT_EQ(watch->take(), Events{Event::unknown});
}

TEST_F(FileEventsTest, WhereInotifyIsRefusedClosesAreLookedForByTheClock) {
  events().refuse();
  const auto watch = events().watch_closes(file);
  EXPECT_FALSE(watch->is_watching());
  pass(FileEvents::kPoll);
  EXPECT_EQ(watch->take(), Events{Event::unknown});
}

TEST_F(FileEventsTest, TheLoopCallsForWhatIsNotTaken) {
  const auto watch = watch_file();
  open_and_close();
  until_called();
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed}));
}

TEST_F(FileEventsTest, ForWhatIsTakenTheLoopHasNothingToDo) {
  const auto watch = watch_file();
  settle(loop);
  open_and_close();
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed}));
  loop.restart();
  EXPECT_FALSE(loop.poll_one());
  EXPECT_EQ(calls, 0);
}

TEST_F(FileEventsTest, MoreThanOneReadOfTheKernelsEventsIsTold) {
  const auto watch = watch_file();
  open_and_close(200);
  const Events all = watch->take();
  ASSERT_EQ(all.size(), 400U);
  for (std::size_t n = 0; n < all.size(); ++n) EXPECT_EQ(all[n], n % 2 == 0 ? Event::opened : Event::closed);
}

TEST_F(FileEventsTest, OfAnotherFileOfTheFolderNothingIsTold) {
  const auto watch = watch_file();
  std::ofstream(dir.path() / "other") << "x";
  EXPECT_EQ(watch->take(), Events{});
}

TEST_F(FileEventsTest, TwoWhoWatchAFileAreBothTold) {
  const auto one = watch_file();
  auto other = watch_file();
  open_and_close();
  EXPECT_EQ(one->take(), (Events{Event::opened, Event::closed}));
  EXPECT_EQ(other->take(), (Events{Event::opened, Event::closed}));
  other.reset();
  open_and_close();
  EXPECT_EQ(one->take(), (Events{Event::opened, Event::closed})) << "the other one's end is its own";
}

TEST_F(FileEventsTest, WhatAnotherOneTakesIsCalledForHere) {
  const auto one = watch_file();
  const auto other = events().watch_file(file);
  open_and_close();
  EXPECT_EQ(other->take(), (Events{Event::opened, Event::closed}));
  settle(loop);
  EXPECT_EQ(calls, 1) << "no event of the kernel's is left to wake it";
}

TEST_F(FileEventsTest, OneThatHasEndedIsNotCalled) {
  auto one = watch_file();
  const auto other = events().watch_file(file);
  open_and_close();
  EXPECT_EQ(other->take().size(), 2U);
  one.reset();
  settle(loop);
  EXPECT_EQ(calls, 0);
}

TEST_F(FileEventsTest, AFilesWatchAndItsFoldersShareWhatTheKernelWatches) {
  auto folder = events().watch_folder(dir.path().string(), "new");
  {
    const auto watch = watch_file();
    EXPECT_TRUE(watch->exact());
  }
  std::ofstream(dir.path() / "new") << "x";
  EXPECT_EQ(folder->take().front(), Event::changed)
      << "the folder is watched after the file's watch has ended";
  const auto again = watch_file();
  folder.reset();
  open_and_close(2);
  EXPECT_EQ(again->take(), (Events{Event::opened, Event::closed, Event::opened, Event::closed}))
      << "it is exact after the folder's watch has ended";
}

// What the kernel watches for this program.
int watched_by_the_kernel() {
  int watched = 0;
  for (const auto& entry : fs::directory_iterator("/proc/self/fdinfo")) {
    std::ifstream info(entry.path());
    for (std::string line; std::getline(info, line);) watched += line.starts_with("inotify ") ? 1 : 0;
  }
  return watched;
}

TEST_F(FileEventsTest, TheKernelWatchesOnlyWhatSomebodyStillWatches) {
  const std::string other_file = (dir.path() / "other").string();
  std::ofstream(other_file) << "x";
  const test::TempDir elsewhere;
  const std::string far_file = (elsewhere.path() / "file").string();
  std::ofstream(far_file) << "x";
  const int before = watched_by_the_kernel();
  auto far = events().watch_file(far_file);
  EXPECT_EQ(watched_by_the_kernel(), before + 2) << "a file and its folder";
  auto one = events().watch_file(file);
  auto same = events().watch_file(file);
  auto other = events().watch_file(other_file);
  EXPECT_EQ(watched_by_the_kernel(), before + 5) << "two more files in one folder";
  one.reset();
  EXPECT_EQ(watched_by_the_kernel(), before + 5) << "somebody else watches the same file";
  same.reset();
  EXPECT_EQ(watched_by_the_kernel(), before + 4) << "the folder has another file";
  other.reset();
  EXPECT_EQ(watched_by_the_kernel(), before + 2);
  far.reset();
  EXPECT_EQ(watched_by_the_kernel(), before);
}

TEST_F(FileEventsTest, AVisitOfOnesOwnIsNotTold) {
  const auto watch = watch_file();
  open_and_close();
  watch->unnoticed([this] { open_and_close(); });
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed})) << "the one before is";
}

TEST_F(FileEventsTest, AVisitHidesNothingElse) {
  const auto watch = watch_file();
  UniqueFd others;
  watch->unnoticed([&] {
    others.reset(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
    open_and_close();
  });
  EXPECT_EQ(watch->take(), Events{Event::opened});
}

TEST_F(FileEventsTest, AVisitThatOpensNothingHidesNothing) {
  const auto watch = watch_file();
  watch->unnoticed([] {});
  EXPECT_EQ(watch->take(), Events{});
}

TEST_F(FileEventsTest, TwoClosesWithinAVisitAreNoneOfItsOwn) {
  const auto watch = watch_file();
  UniqueFd one(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  UniqueFd other(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  (void)watch->take();
  watch->unnoticed([&] {
    one.reset();
    other.reset();
  });
  EXPECT_EQ(watch->take(), (Events{Event::closed, Event::closed}));
}

TEST_F(FileEventsTest, WhatIsFoundInAVisitOfAnothersIsCalledForHere) {
  const auto one = watch_file();
  const auto other = events().watch_file(file);
  other->unnoticed([this] { open_and_close(); });
  settle(loop);
  EXPECT_EQ(calls, 1);
}

TEST_F(FileEventsTest, AFolderThatIsWatchedForANameIsNoFileWhoseOpensAreExact) {
  EXPECT_FALSE(events().watch_folder(dir.path().string(), "any")->exact());
}

TEST_F(FileEventsTest, TheEndOfTheLastWatchIsTheEndOfAllThatTheKernelDoes) {
  const std::string other_file = (dir.path() / "other").string();
  std::ofstream(other_file) << "x";
  const test::TempDir elsewhere;
  const std::string far_file = (elsewhere.path() / "file").string();
  std::ofstream(far_file) << "x";
  const int before = watched_by_the_kernel();
  (void)watch_file();
  EXPECT_EQ(watched_by_the_kernel(), before);
  auto one = watch_file();
  const auto far = events().watch_file(far_file);
  EXPECT_EQ(watched_by_the_kernel(), before + 4);
  one.reset();
  EXPECT_EQ(watched_by_the_kernel(), before + 2) << "nothing is remembered of the first";
}

TEST_F(FileEventsTest, WithoutInotifyTheEndOfTheLastWatchIsTheEndOfTheLooks) {
  events().refuse();
  auto watch = watch_file();
  EXPECT_TRUE(loop.next_timer());
  watch.reset();
  EXPECT_FALSE(loop.next_timer());
}

TEST_F(FileEventsTest, OneMoreFileDoesNotPutTheLookOff) {
  events().refuse();
  const auto watch = watch_file();
  pass(milliseconds(60));
  const auto other = events().watch_file((dir.path() / "other").string());
  pass(milliseconds(40));
  EXPECT_EQ(calls, 1);
}

TEST_F(FileEventsTest, OneMoreFileDoesNotPutTheQuickLookOff) {
  events().begin_after(milliseconds(1));
  const auto watch = watch_file();
  pass(microseconds(200));
  const auto other = events().watch_file((dir.path() / "other").string());
  pass(microseconds(50));
  EXPECT_EQ(calls, 1);
}

TEST_F(FileEventsTest, TheTroubleIsThatOfTheFirstFile) {
  const auto first = events().watch_file((dir.path() / "first").string());
  const auto second = events().watch_file((dir.path() / "second").string());
  const std::string trouble = events().take_trouble();
  EXPECT_NE(trouble.find("first"), std::string::npos) << trouble;
  EXPECT_EQ(trouble.find("second"), std::string::npos) << trouble;
}

TEST_F(FileEventsTest, AWatchMayOutliveThem) {
  auto own = std::make_unique<FileEvents>(loop);
  const auto watch = own->watch_file(file);
  own.reset();
  EXPECT_TRUE(watch->is_watching()) << "it was, and its end harms nobody";
}

TEST_F(FileEventsTest, AFoldersNameIsToldAsItComesAndGoes) {
  const auto watch = events().watch_folder(dir.path().string(), "new");
  std::ofstream(dir.path() / "other") << "x";
  EXPECT_EQ(watch->take(), Events{});
  const fs::path name = dir.path() / "new";
  const auto is_told = [&watch] {
    const Events all = watch->take();
    return !all.empty() && all.front() == Event::changed;
  };
  std::ofstream{name};
  EXPECT_TRUE(is_told());
  fs::permissions(name, fs::perms::owner_read);
  EXPECT_TRUE(is_told());
  fs::rename(name, dir.path() / "old");
  EXPECT_TRUE(is_told());
  fs::rename(dir.path() / "old", name);
  EXPECT_TRUE(is_told());
  fs::remove(name);
  EXPECT_TRUE(is_told());
}

TEST_F(FileEventsTest, AFolderThatGoesIsTold) {
  fs::create_directory(dir.path() / "folder");
  const auto watch = events().watch_folder((dir.path() / "folder").string(), "any");
  fs::remove(dir.path() / "folder");
  const Events all = watch->take();
  ASSERT_FALSE(all.empty());
  EXPECT_EQ(all.front(), Event::changed);
}

TEST_F(FileEventsTest, WhatIsNotThereIsNotWatched) {
  EXPECT_FALSE(events().watch_file((dir.path() / "none").string())->is_watching());
  EXPECT_FALSE(events().watch_folder((dir.path() / "none").string(), "any")->is_watching());
}

TEST_F(FileEventsTest, LostEventsAreToldToAll) {
  const auto watch = watch_file();
  const auto folder = events().watch_folder(dir.path().string(), "any");
  events().lose();
  EXPECT_EQ(watch->take(), Events{Event::unknown});
  EXPECT_EQ(folder->take(), Events{Event::unknown});
}

TEST_F(FileEventsTest, WithoutInotifyAFileIsLookedAtEveryTenthOfASecond) {
  events().refuse();
  const auto watch = watch_file();
  EXPECT_FALSE(watch->is_watching());
  EXPECT_FALSE(watch->exact());
  pass(milliseconds(99));
  EXPECT_EQ(calls, 0);
  pass(milliseconds(1));
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(watch->take(), Events{Event::unknown});
  pass(milliseconds(99));
  EXPECT_EQ(calls, 1);
  pass(milliseconds(1));
  EXPECT_EQ(calls, 2);
}

TEST_F(FileEventsTest, WithoutInotifyAFolderIsSilent) {
  events().refuse();
  const auto folder = events().watch_folder(dir.path().string(), "any");
  folder->on_event([this] { ++calls; });
  pass(std::chrono::seconds(1));
  EXPECT_EQ(calls, 0);
  EXPECT_FALSE(loop.next_timer()) << "nothing is looked at for it";
}

TEST_F(FileEventsTest, TheTroubleIsTakenOnce) {
  EXPECT_EQ(events().take_trouble(), "");
  const auto gone = events().watch_file((dir.path() / "none").string());
  const std::string trouble = events().take_trouble();
  EXPECT_NE(trouble.find("inotify for " + (dir.path() / "none").string()), std::string::npos);
  EXPECT_NE(trouble.find("No such file or directory"), std::string::npos);
  EXPECT_NE(trouble.find("every 100 ms"), std::string::npos);
  const auto other = events().watch_file((dir.path() / "no other").string());
  EXPECT_EQ(events().take_trouble(), "");
}

TEST_F(FileEventsTest, BeforeEventsBeginAFileIsLookedAtQuickly) {
  events().begin_after(milliseconds(1));
  const auto watch = watch_file();
  EXPECT_FALSE(watch->is_watching());
  pass(microseconds(249));
  EXPECT_EQ(calls, 0);
  pass(microseconds(1));
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(watch->take(), Events{Event::unknown});
  pass(microseconds(250));
  EXPECT_EQ(calls, 2);
  (void)watch->take();
  pass(milliseconds(1));
  EXPECT_TRUE(watch->is_watching());
  (void)watch->take();
  EXPECT_FALSE(loop.next_timer()) << "from now on the kernel tells";
  open_and_close();
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed}));
}

TEST_F(FileEventsTest, WhenEventsBeginAFolderIsToldWhatMayHaveComeBefore) {
  events().begin_after(milliseconds(1));
  const auto folder = events().watch_folder(dir.path().string(), "any");
  pass(microseconds(999));
  EXPECT_EQ(folder->take(), Events{});
  pass(microseconds(251));
  EXPECT_TRUE(folder->is_watching());
  EXPECT_EQ(folder->take(), Events{Event::unknown});
}

TEST_F(FileEventsTest, WhatTheKernelRefusesIsToldAndTheFileIsLookedAt) {
  const std::pair<test::RefusedCall, std::string> cases[] = {
      {{SYS_inotify_init1, EMFILE}, "Too many open files"},
      {{SYS_inotify_init1, ENFILE}, "Too many open files in system"},
      {{SYS_inotify_add_watch, ENOSPC}, "No space left on device"},
      {{SYS_inotify_add_watch, ENOMEM}, "Cannot allocate memory"},
      {{SYS_inotify_add_watch, EACCES}, "Permission denied"}};
  for (const auto& [call, why] : cases) {
    FileEvents own(loop);
    std::unique_ptr<FileEvents::Watch> watch;
    std::unique_ptr<FileEvents::Watch> folder;
    EXPECT_TRUE(test::while_refused({call}, [&] {
      folder = own.watch_folder(dir.path().string(), "any");
      EXPECT_EQ(own.take_trouble(), "") << "a folder has one who looks";
      watch = own.watch_file(file);
    }));
    EXPECT_EQ(own.take_trouble(),
              "inotify for " + file + ": " + why +
                  "; opens and closes are looked for every 100 ms instead, several quick ones may count as "
                  "one (sysctl fs.inotify.max_user_instances, fs.inotify.max_user_watches)");
    EXPECT_FALSE(folder->is_watching());
    EXPECT_FALSE(watch->is_watching());
    EXPECT_FALSE(watch->exact());
    calls = 0;
    watch->on_event([this] { ++calls; });
    pass(milliseconds(100));
    EXPECT_EQ(calls, 1);
    EXPECT_EQ(watch->take(), Events{Event::unknown});
    const auto second = own.watch_file(file);
    EXPECT_TRUE(second->exact()) << "the kernel has room again";
    open_and_close();
    EXPECT_EQ(second->take(), (Events{Event::opened, Event::closed}));
  }
}

TEST_F(FileEventsTest, WithoutItsFoldersEventsAFilesAreNotExact) {
  std::unique_ptr<FileEvents::Watch> watch;
  EXPECT_TRUE(test::while_refused(
      {{SYS_inotify_add_watch, ENOSPC, test::RefusedCall::Argument{2, IN_ONLYDIR, IN_ONLYDIR}}},
      [&] { watch = watch_file(); }));
  EXPECT_TRUE(watch->is_watching());
  EXPECT_FALSE(watch->exact());
  open_and_close();
  until_called();
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed}));
  EXPECT_EQ(events().take_trouble(), "");
}

TEST_F(FileEventsTest, EventsThatCannotBeReadNowAreReadLater) {
  const auto watch = watch_file();
  open_and_close();
  for (const int error : {EAGAIN, EIO}) {
    EXPECT_TRUE(test::while_refused({{SYS_read, error}}, [&] { EXPECT_EQ(watch->take(), Events{}); }));
  }
  EXPECT_EQ(watch->take(), (Events{Event::opened, Event::closed}));
}

TEST_F(FileEventsTest, AWatchThatTheKernelDoesNotEndIsOverAllTheSame) {
  auto watch = watch_file();
  const auto other = events().watch_file((dir.path() / "file").string());
  const auto folder = events().watch_folder(dir.path().string(), "file");
  EXPECT_TRUE(test::while_refused({{SYS_inotify_rm_watch, EINVAL}}, [&] { watch.reset(); }));
  open_and_close();
  EXPECT_EQ(other->take(), (Events{Event::opened, Event::closed}));
  settle(loop);
  EXPECT_EQ(calls, 0);
}

}  // namespace
}  // namespace porttape
