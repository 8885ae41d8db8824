#include "libport/tape/tape_set.hpp"

#include <algorithm>
#include <fcntl.h>
#include <filesystem>
#include <optional>
#include <signal.h>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_lock.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/tape_folder.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::MatchesRegex;

class TapeSetTest : public test::TapeFolder {
 protected:
  // Of both tapes, each file with its text.
  static void make(TapeSet& set, const TapePaths& tape, const std::string& text) {
    const auto place = set.place(tape);
    ASSERT_TRUE(place);
    write_all(*place, text);
  }
  TapeSet begin(OnExisting on_existing) {
    auto set = TapeSet::begin(one, on_existing);
    if (!set) throw std::runtime_error(set.error().message);
    return std::move(*set);
  }

  TapePaths one = literal_tape(dir / "one.log");
  TapePaths two = literal_tape(dir / "two.log");
};

TEST_F(TapeSetTest, AppearsTogetherOutOfAHiddenFolder) {
  {
    TapeSet set = begin(OnExisting::refuse);
    make(set, one, "1");
    make(set, two, "2");
    EXPECT_THAT(names(), ElementsAre(MatchesRegex("\\.one\\.log\\.[A-Za-z0-9]{6}")));
    ASSERT_TRUE(set.publish());
    EXPECT_EQ(names().size(), 7U);
  }
  EXPECT_EQ(names().size(), 6U);
  expect_all(one, "1");
  expect_all(two, "2");
}

TEST_F(TapeSetTest, GoesAwayUnlessItIsPublished) {
  {
    TapeSet set = begin(OnExisting::refuse);
    make(set, one, "1");
  }
  EXPECT_TRUE(names().empty());
}

TEST_F(TapeSetTest, WhereNoFolderCanBeMadeItIsNamed) {
  EXPECT_EQ(TapeSet::begin(literal_tape(dir / "no/t"), OnExisting::refuse).error(),
            make_error(Errc::usage, "cannot make tapes in the folder '" + (dir / "no") +
                                        "': its folder does not exist; type mkdir -p " + (dir / "no")));
}

TEST_F(TapeSetTest, ANameThatIsTakenHasNoPlace) {
  for (const fs::path& path : {one.read, one.write, one.events}) {
    test::write_file(path, {});
    TapeSet set = begin(OnExisting::refuse);
    EXPECT_EQ(set.place(one).error(),
              make_error(Errc::usage, "there is a tape '" + (dir / "one.log") +
                                          "' already; take another name, or --overwrite "
                                          "to replace it"));
    EXPECT_TRUE(set.place(two));
    EXPECT_TRUE(begin(OnExisting::overwrite).place(one));
    fs::remove(path);
    fs::create_directory(path);
    for (const OnExisting how : {OnExisting::refuse, OnExisting::overwrite})
      EXPECT_THAT(begin(how).place(one).error().message, HasSubstr("is not a regular file"));
    fs::remove(path);
  }
}

TEST_F(TapeSetTest, ANameThatIsTakenMeanwhileIsLeftToWhoHasIt) {
  TapeSet set = begin(OnExisting::refuse);
  make(set, one, "1");
  make(set, two, "2");
  test::write_file(two.read, test::bytes_of("theirs"));
  EXPECT_THAT(set.publish().error().message,
              HasSubstr("there is a tape '" + (dir / "two.log") + "' already"));
  EXPECT_EQ(names().size(), 2U);
  EXPECT_EQ(content_of(two.read), "theirs");
}

TEST_F(TapeSetTest, WhatIsToBeReplacedIsSoByAll) {
  write_all(one, "old");
  TapeSet set = begin(OnExisting::overwrite);
  make(set, one, "1");
  make(set, two, "2");
  expect_all(one, "old");
  ASSERT_TRUE(set.publish());
  expect_all(one, "1");
  expect_all(two, "2");
}

// A tape whose last file was never made.
TEST_F(TapeSetTest, WhereOneCannotBeMovedAllIsAsItWas) {
  for (const bool replaced : {false, true}) {
    write_all(one, "old");
    if (replaced) write_all(two, "old");
    {
      TapeSet set = begin(OnExisting::overwrite);
      make(set, one, "1");
      const auto place = set.place(two);
      ASSERT_TRUE(place);
      write_all(*place, "2");
      fs::remove(place->read);
      const auto published = set.publish();
      EXPECT_EQ(published.error(),
                make_error(Errc::io, "cannot make '" + two.read.string() + "': No such file or directory"));
    }
    expect_all(one, "old");
    if (replaced) expect_all(two, "old");
    EXPECT_EQ(names().size(), replaced ? 6U : 3U);
  }
}

TEST_F(TapeSetTest, AFileThatSomebodyHoldsIsNotReplaced) {
  write_all(one, "old");
  TapeSet set = begin(OnExisting::overwrite);
  make(set, one, "1");
  const UniqueFd reader(::open(one.write.c_str(), O_RDONLY | O_CLOEXEC));
  struct flock lock {};
  lock.l_type = F_RDLCK;  // such a lock is nobody's who writes, so that only the move comes upon it
  lock.l_whence = SEEK_SET;
  ASSERT_EQ(::fcntl(reader.get(), F_OFD_SETLK, &lock), 0);
  EXPECT_EQ(set.publish().error(),
            make_error(Errc::usage, "'" + one.write.string() + "' is locked by a program that reads it"));
  expect_all(one, "old");
}

TEST_F(TapeSetTest, TheSignalsThatWereBlockedAreSoAfterwards) {
  const auto blocked = [] {
    sigset_t now{};
    ::pthread_sigmask(SIG_BLOCK, nullptr, &now);
    std::vector<int> numbers;
    for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGUSR1}) {
      if (::sigismember(&now, number) == 1) numbers.push_back(number);
    }
    return numbers;
  };
  const std::vector<int> before = blocked();
  TapeSet set = begin(OnExisting::refuse);
  make(set, one, "1");
  ASSERT_TRUE(set.publish());
  EXPECT_EQ(blocked(), before);
}

}  // namespace
}  // namespace porttape
