#include "libport/pack/make_pack.hpp"

#include <atomic>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <string>
#include <sys/stat.h>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/pack/unpack.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::MemoryTape;
using testing::HasSubstr;

class MakePackTest : public testing::Test {
 protected:
  MakePackTest() {
    fs::create_directory(dir / "tapes");
    tape =
        test::write_tape(literal_tape(dir / "tapes/t.log"), MemoryTape().open(0).write(1, "a").read(2, "b"),
                         {.device = "d", .driver = "p", .id = "0123"});
    test::write_file(dir / "secret",
                     as_bytes("{\"format\":\"porttape-events\",\"version\":1,\"id\":\"s\"}\n"));
    fs::create_symlink(dir / "secret", dir / "tapes/link");
  }
  std::string why() {
    const auto packed = make_pack({tape}, dir / "p.tar.zst", {.overwrite = true});
    return packed ? std::string() : packed.error().message;
  }

  test::TempDir dir;
  TapePaths tape;
};

TEST_F(MakePackTest, AFileThatIsExchangedWhileAnotherIsReadIsPackedAsItWasChecked) {
  const Bytes events = test::read_file(tape.events);
  bool exchanged = false;
  const auto exchange = [&](std::uint64_t) {
    if (exchanged) return;
    exchanged = true;
    fs::rename(dir / "tapes/link", tape.events);
  };
  const auto packed = make_pack({tape}, dir / "p.tar.zst", {.progress = exchange});
  ASSERT_TRUE(packed) << packed.error().message;
  ASSERT_TRUE(exchanged && fs::is_symlink(tape.events));
  EXPECT_EQ(packed->tapes[0].id, "0123");
  const auto unpacked = unpack(dir / "p.tar.zst", dir / "out", {});
  ASSERT_TRUE(unpacked) << unpacked.error().message;
  EXPECT_EQ(test::read_file(dir / "out/t.loge"), events);
}

TEST_F(MakePackTest, NoByteOfAnotherFolderGetsInHoweverOftenTheFileIsExchanged) {
  const auto known = make_pack({tape}, dir / "known.tar.zst", {});
  ASSERT_TRUE(known) << known.error().message;
  std::atomic<bool> ended = false;
  std::atomic<unsigned> exchanges = 0;
  std::thread stranger([&] {
    while (!ended) {
      const std::string link = dir / "tapes/link";
      if (::renameat2(AT_FDCWD, link.c_str(), AT_FDCWD, tape.events.c_str(), RENAME_EXCHANGE) == 0)
        ++exchanges;
    }
  });
  for (int n = 0; n < 300; ++n) {
    const auto packed = make_pack({tape}, dir / "p.tar.zst", {.overwrite = true});
    if (!packed) {
      EXPECT_EQ(packed.error().code, Errc::usage) << packed.error().message;
      continue;
    }
    EXPECT_EQ(packed->files, known->files);
    EXPECT_EQ(packed->tapes, known->tapes);
  }
  ended = true;
  stranger.join();
  EXPECT_GT(exchanges, 0U);
}

TEST_F(MakePackTest, LinksAreFollowedWithinTheFolderAlone) {
  fs::rename(tape.events, dir / "tapes/kept");
  for (const std::string& text : {std::string("kept"), std::string("../tapes/kept"), dir / "tapes/kept"}) {
    fs::create_symlink(text, tape.events);
    EXPECT_EQ(why(), "") << text;
    fs::remove(tape.events);
  }
  fs::create_symlink("link", tape.events);
  EXPECT_THAT(why(), HasSubstr("is a link that leads out of its folder, to '" + (dir / "secret") + "'"));
  fs::remove(tape.events);
  fs::create_symlink("t.loge", tape.events);
  EXPECT_THAT(why(), HasSubstr("Too many levels of symbolic links"));
}

TEST_F(MakePackTest, WhatIsNoRegularFileIsNotWaitedFor) {
  fs::remove(tape.events);
  ASSERT_EQ(::mkfifo(tape.events.c_str(), 0600), 0);
  EXPECT_THAT(why(), HasSubstr("t.loge is a FIFO; a tape is made of regular files"));
  fs::rename(tape.events, dir / "tapes/fifo");
  fs::create_symlink("fifo", tape.events);
  EXPECT_THAT(why(), HasSubstr("t.loge is a FIFO"));
  fs::remove(tape.events);
  fs::create_directory(tape.events);
  EXPECT_THAT(why(), HasSubstr("t.loge is a folder"));
}

TEST_F(MakePackTest, ATapeWithoutEventsIsPacked) {
  fs::remove(tape.events);
  EXPECT_EQ(why(), "");
  fs::remove(tape.read);
  fs::remove(tape.write);
  EXPECT_THAT(why(), HasSubstr("no tape"));
}

}  // namespace
}  // namespace porttape
