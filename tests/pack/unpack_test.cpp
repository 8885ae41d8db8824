#include "libport/pack/unpack.hpp"

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/pack/make_pack.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::MemoryTape;
using testing::HasSubstr;

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

class UnpackTest : public testing::Test {
 protected:
  std::string why(const std::string& pack, const std::string& folder) {
    const auto done = unpack(dir / pack, dir / folder, {});
    return done ? "" : done.error().message;
  }
  [[nodiscard]] std::size_t entries() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()));
  }

  test::TempDir dir;
  TapePaths tape =
      test::write_tape(literal_tape(dir / "t.log"), MemoryTape().open(0).write(1, "a").read(2, "b"),
                       {.device = "d", .driver = "p", .id = "0123"});
};

TEST_F(UnpackTest, TheSameFilesComeOut) {
  for (const char* const name : {"p.tar.zst", "p.tgz"}) {
    const auto packed = make_pack({tape}, dir / name, {.about = {.driver_command = "d"}});
    ASSERT_TRUE(packed) << packed.error().message;
    EXPECT_EQ(packed->tapes[0].verdict, "sound");
    EXPECT_EQ(packed->tapes[0].id, "0123");
    const std::string folder = std::string(name) + ".out";
    EXPECT_EQ(why(name, folder), "");
    for (const fs::path& path : {tape.read, tape.write, tape.events})
      EXPECT_EQ(content(fs::path(dir / folder) / path.filename()), content(path));
    EXPECT_THAT(content(fs::path(dir / folder) / "manifest.json"), HasSubstr(R"("command":"d")"));
  }
}

TEST_F(UnpackTest, ALinkOutOfItsFolderIsNotPacked) {
  const std::string away = dir / "away";
  fs::create_directory(away);
  test::write_file(away + "/secret", as_bytes("{\"t_us\":0,\"event\":\"open\"}\n"));
  fs::rename(tape.events, dir / "kept");
  fs::create_symlink("kept", tape.events);
  EXPECT_TRUE(make_pack({tape}, dir / "p.tar.zst", {})) << "within the folder";
  fs::remove(tape.events);
  fs::create_symlink(away + "/secret", tape.events);
  const auto packed = make_pack({tape}, dir / "q.tar.zst", {});
  ASSERT_FALSE(packed);
  EXPECT_EQ(packed.error().code, Errc::usage);
  EXPECT_THAT(packed.error().message, HasSubstr("is a link that leads out of its folder, to '" + away +
                                                "/secret'; if that belongs to the tape, put a copy"));
  EXPECT_FALSE(fs::exists(dir / "q.tar.zst"));
}

TEST_F(UnpackTest, ATapeWithAHoleIsNotPacked) {
  fs::resize_file(tape.read, std::uintmax_t{1} << 40U);
  const auto source = FileSource::open(tape.read);
  ASSERT_TRUE(source);
  if ((*source)->stored(1 << 20U).begin <= 1 << 20U) GTEST_SKIP() << "this file system tells of no holes";
  const auto packed = make_pack({tape}, dir / "p.tar.zst", {});
  ASSERT_FALSE(packed);
  EXPECT_THAT(packed.error().message, HasSubstr("has a hole: a part of it was never written"));
  EXPECT_FALSE(fs::exists(dir / "p.tar.zst"));
}

TEST_F(UnpackTest, WhatIsMadeOfATapeIsNotForMorePeople) {
  ASSERT_TRUE(make_pack({tape}, dir / "p.tar.zst", {}));
  ASSERT_EQ(why("p.tar.zst", "out"), "");
  for (const fs::path& path : {fs::path(dir / "p.tar.zst"), fs::path(dir / "out/t.logr")})
    EXPECT_EQ(fs::status(path).permissions() & fs::perms::others_all, fs::perms::none) << path;
}

TEST_F(UnpackTest, NothingIsOverwritten) {
  ASSERT_TRUE(make_pack({tape}, dir / "p.tar.zst", {}));
  const auto again = make_pack({tape}, dir / "p.tar.zst", {});
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, Errc::usage);
  EXPECT_TRUE(make_pack({tape}, dir / "p.tar.zst", {.overwrite = true}));
  fs::create_directory(dir / "there");
  fs::create_symlink("nowhere", dir / "link");
  const std::size_t before = entries();
  EXPECT_THAT(why("p.tar.zst", "there"), HasSubstr("there already"));
  EXPECT_THAT(why("p.tar.zst", "link"), HasSubstr("there already"));
  EXPECT_FALSE(make_pack({tape}, dir / "there", {.overwrite = true}));
  EXPECT_FALSE(make_pack({tape}, dir / "link", {.overwrite = true}));
  EXPECT_EQ(entries(), before);
}

TEST_F(UnpackTest, NothingIsLeftOfWhatIsWrong) {
  ASSERT_TRUE(make_pack({tape}, dir / "p.tar.zst", {}));
  fs::resize_file(dir / "p.tar.zst", fs::file_size(dir / "p.tar.zst") - 20);
  const std::size_t before = entries();
  EXPECT_NE(why("p.tar.zst", "out"), "");
  EXPECT_NE(why("t.logr", "out"), "");
  EXPECT_EQ(entries(), before);
}

TEST_F(UnpackTest, ADamagedTapeIsPackedAsItIs) {
  fs::resize_file(tape.read, 0);
  const auto packed = make_pack({tape}, dir / "p.tar.zst", {});
  ASSERT_TRUE(packed) << packed.error().message;
  EXPECT_EQ(packed->tapes[0].verdict, "damaged");
  EXPECT_EQ(why("p.tar.zst", "out"), "");
}

TEST_F(UnpackTest, AnOddIdIsKept) {
  std::ofstream(tape.events) << R"({"format":"porttape-events","version":1,"id":"a)" << '\xff' << "\"}\n";
  const auto packed = make_pack({tape}, dir / "p.tar.zst", {});
  ASSERT_TRUE(packed) << packed.error().message;
  EXPECT_EQ(why("p.tar.zst", "out"), "");
}

TEST_F(UnpackTest, TwoTapesOfOneNameDoNotGoTogether) {
  const auto packed = make_pack({tape, tape}, dir / "p.tar.zst", {});
  ASSERT_FALSE(packed);
  EXPECT_THAT(packed.error().message, HasSubstr("two tapes are called 't.log'"));
  const auto report = make_pack({tape}, dir / "p.tar.zst", {.redaction = tape.events});
  ASSERT_FALSE(report);
  EXPECT_THAT(report.error().message, HasSubstr("no report"));
}

}  // namespace
}  // namespace porttape
