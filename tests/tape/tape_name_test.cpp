#include "libport/tape/tape_name.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::TempDir;
using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;

std::string found(const std::string& argument) {
  const auto paths = find_tape(argument);
  return paths ? paths->name() : "error: " + paths.error().message;
}

TEST(TapeName, ALiteralNameGetsItsLetters) {
  const TapePaths paths = literal_tape("a/laser");
  EXPECT_EQ(paths, (TapePaths{"a/laserr", "a/laserw", "a/lasere"}));
  EXPECT_EQ(paths.name(), "a/laser");
}

TEST(TapeName, ANewTapeEndsInLog) {
  for (const auto* argument : {"laser", "laser.log", "laser.logr", "laser.logw", "laser.loge"}) {
    EXPECT_EQ(new_tape(argument).name(), "laser.log") << argument;
  }
  EXPECT_EQ(new_tape("solar").name(), "solar.log");
  EXPECT_EQ(new_tape("a.b").name(), "a.b.log");
  EXPECT_EQ(new_tape("dir.log/x").name(), "dir.log/x.log");
}

TEST(TapeName, ANewTapeIsNoFolderAndNoDevice) {
  const TempDir dir;
  for (const std::string& folder :
       {std::string("."), std::string(".."), dir / "", std::string("/"), dir / "x/.."}) {
    const Result<TapePaths> named = named_new_tape(folder);
    ASSERT_FALSE(named.has_value()) << folder;
    EXPECT_EQ(named.error().code, Errc::usage);
    EXPECT_NE(named.error().message.find("is a folder"), std::string::npos) << named.error().message;
  }
  for (const std::string device : {"/dev/null", "/dev/tty"})
    EXPECT_EQ(named_new_tape(device).error().message,
              "'" + device + "' is a device, which holds no tape; give another name");
  EXPECT_FALSE(named_new_tape("").has_value());
  test::write_file(dir / "laser", {});
  EXPECT_EQ(named_new_tape(dir / "laser")->name(), dir / "laser.log")
      << "a file of that name is none of the tape's";
  EXPECT_EQ(named_new_tape(std::string(dir / "laser") + ".logr")->name(), dir / "laser.log");
}

TEST(TapeName, EverySpellingFindsTheTape) {
  const TempDir dir;
  test::write_file(dir / "laser.logr", {});
  for (const auto* argument : {"laser", "laser.log", "laser.logr", "laser.logw", "laser.loge"}) {
    EXPECT_EQ(found(dir / argument), dir / "laser.log") << argument;
  }
}

TEST(TapeName, AWriteFileAloneIsATape) {
  const TempDir dir;
  test::write_file(dir / "laser.logw", {});
  EXPECT_EQ(found(dir / "laser"), dir / "laser.log");
  EXPECT_EQ(found(dir / "laser.logr"), dir / "laser.log");
}

TEST(TapeName, TheTapesOfConnectionsStandBesideTheFirst) {
  EXPECT_EQ(connection_tape(new_tape("laser"), 1).name(), "laser.log");
  EXPECT_EQ(connection_tape(new_tape("laser"), 2).name(), "laser.c2.log");
  EXPECT_EQ(connection_tape(numbered_tape(new_tape("laser"), 3), 12).name(), "laser.3.c12.log");
  EXPECT_EQ(connection_tape(literal_tape("x"), 2).name(), "x.c2");
}

TEST(TapeName, TheConnectionsOfAGroupAreFoundByTheirNames) {
  const TempDir dir;
  const TapePaths first = new_tape(dir / "laser");
  EXPECT_EQ(recorded_connections(first), std::vector<unsigned>());
  for (const char* name :
       {"laser.c10.logr", "laser.c2.logw", "laser.c2.logr", "laser.c3.loge", "laser.2.c4.logr",
        "laser.c1.logr", "laser.c05.logr", "laser.cx.logr", "laser.c6.log", "laser.c7.logx", "other.c8.logr",
        "laser.c.logr", "laser.c99999999999.logr"})
    test::write_file(dir / name, {});
  EXPECT_EQ(recorded_connections(first), (std::vector<unsigned>{2, 3, 10}));
  test::write_file(dir / "laser.loge", {});
  EXPECT_EQ(recorded_connections(first), (std::vector<unsigned>{1, 2, 3, 10}));
  EXPECT_EQ(recorded_connections(new_tape("/nowhere/laser")), std::vector<unsigned>());
}

TEST(TapeName, TheLiteralNameComesFirst) {
  const TempDir dir;
  test::write_file(dir / "laserr", {});
  test::write_file(dir / "laser.logr", {});
  EXPECT_EQ(found(dir / "laser"), dir / "laser");
  EXPECT_EQ(found(dir / "laser.log"), dir / "laser.log");
  EXPECT_EQ(found(dir / "laserr"), dir / "laser");
}

TEST(TapeName, AFolderDoesNotHideATape) {
  const TempDir dir;
  std::filesystem::create_directory(dir / "laserr");
  EXPECT_EQ(found(dir / "laser"), dir / "laser");  // opening it tells what is wrong
  test::write_file(dir / "laser.logr", {});
  EXPECT_EQ(found(dir / "laser"), dir / "laser.log");
}

TEST(TapeName, OddCharactersAreJustCharacters) {
  const TempDir dir;
  for (const std::string name :
       {" two words", "-dash", "new\nline", "caf\xc3\xa9", "\xff\xfe", "a,b=c", "%s", "*"}) {
    test::write_file(dir / (name + ".logr"), {});
    EXPECT_EQ(found(dir / name), dir / (name + ".log"));
  }
}

TEST(TapeName, ErrorsSayWhatWasLookedFor) {
  const TempDir dir;
  const auto paths = find_tape(dir / "x");
  ASSERT_FALSE(paths);
  EXPECT_EQ(paths.error().code, Errc::usage);
  EXPECT_THAT(paths.error().message, HasSubstr(dir / "xr"));
  EXPECT_THAT(paths.error().message, HasSubstr(dir / "x.logr"));
  EXPECT_EQ(find_tape("").error().code, Errc::usage);
}

TEST(TapeName, ATapeOfANearNameIsNamed) {
  const TempDir dir;
  test::write_file(dir / "laser.logr", {});
  for (const char* argument : {"lasr", "laesr", "Laser"}) {
    const auto paths = find_tape(dir / argument);
    ASSERT_FALSE(paths) << argument;
    EXPECT_THAT(paths.error().message, EndsWith("; did you mean '" + (dir / "laser") + "'?"));
  }
  EXPECT_THAT(find_tape(dir / "lasr.log").error().message, EndsWith("'" + (dir / "laser.log") + "'?"));
  EXPECT_THAT(find_tape(dir / "radar").error().message, Not(HasSubstr("did you mean")));
}

TEST(TapeName, ALinkThatLeadsNowhereIsToldAsOne) {
  const TempDir dir;
  std::filesystem::create_symlink("loop.logr", dir / "loop.logr");
  EXPECT_THAT(find_tape(dir / "loop").error().message,
              HasSubstr("'" + (dir / "loop.logr") + "', a link that leads nowhere"));
}

TEST(TapeName, EventsAloneAreNoTapeAndAreNamed) {
  const TempDir dir;
  for (const char* name : {"x", "y.log"}) {
    test::write_file(dir / (std::string(name) + "e"), {});
    EXPECT_EQ(
        find_tape(dir / std::string(name).substr(0, 1)).error(),
        make_error(Errc::usage, "no tape '" + (dir / std::string(name).substr(0, 1)) + "': there is only '" +
                                    (dir / name) + "e', the events of one whose r and w files are missing"));
  }
}

TEST(TapeName, AFileOfThatVeryNameIsNoTape) {
  const TempDir dir;
  EXPECT_EQ(find_tape(dir / "abc").error().message, "no tape '" + (dir / "abc") + "': there is neither '" +
                                                        (dir / "abcr") + "' nor '" + (dir / "abc.logr") +
                                                        "'");
  test::write_file(dir / "abc", {});
  EXPECT_THAT(find_tape(dir / "abc").error().message, EndsWith("' (a tape's files end in r and w)"));
}

TEST(TapeName, PartsAndNumbersStandBeforeTheSuffix) {
  const TapePaths first = new_tape("laser");
  EXPECT_EQ(numbered_tape(first, 0), first);
  EXPECT_EQ(numbered_tape(first, 1), first);
  EXPECT_EQ(numbered_tape(first, 2).name(), "laser.2.log");
  EXPECT_EQ(part_tape(first, 1).name(), "laser.1.log");
  EXPECT_EQ(part_tape(literal_tape("x"), 12).name(), "x.12");
  EXPECT_EQ(connection_tape(first, 0), first);
  EXPECT_EQ(literal_tape("a/b.log").file_name(), "b.log");
  EXPECT_EQ(TapePaths().name(), "");
}

}  // namespace
}  // namespace porttape
