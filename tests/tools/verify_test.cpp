#include <filesystem>
#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_writer.hpp"
#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using test::TempDir;
using testing::HasSubstr;
using testing::Not;

// A tape as this recorder makes it.
std::string record(const TempDir& dir, const std::string& name, std::string_view answer) {
  auto writer =
      TapeWriter::create(literal_tape(dir / (name + ".log")), {"device", "driver"}, {.sync = false});
  writer->write_block(tape_time_us(1), as_bytes("ask"));
  writer->read_block(tape_time_us(2), as_bytes(answer));
  EXPECT_TRUE(writer->finish(tape_time_us(3)));
  return dir / (name + ".log");
}

TEST(Verify, ASoundTapeIs0) {
  const TempDir dir;
  const std::string tape = record(dir, "t", "answer");
  const auto ran = run({"verify", tape});
  EXPECT_EQ(ran.status, 0);
  EXPECT_EQ(ran.out, tape + ": sound: 1 read and 1 write blocks, 0.000003 s\n");
}

TEST(Verify, WithoutDigestsItSaysWhatItCannotSee) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{1, "a"}}, {{2, "b"}}, "{\"t_us\":3,\"event\":\"end\"}\n");
  const auto ran = run({"verify", tape});
  EXPECT_EQ(ran.status, 0);
  EXPECT_EQ(ran.out,
            tape + ": no damage found, as far as it can be checked: 1 read and 1 write blocks, 0.000003 s\n" +
                tape + ": note: no digests in " + tape +
                "e, nor how much it was: a missing, swapped, shortened or foreign file would not be "
                "seen\n" +
                tape + ": note: times and events are not covered: " + tape +
                "e has no digests of them, so a changed one would not be seen\n");
}

TEST(Verify, AFileOfAnotherTapeIs1AndNamed) {
  const TempDir dir;
  const std::string tape = record(dir, "t", "answer");
  const std::string other = record(dir, "other", "another");
  std::filesystem::copy_file(other + "r", tape + "r", std::filesystem::copy_options::overwrite_existing);
  const auto ran = run({"verify", tape});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out, HasSubstr(tape + ": damaged: " + tape +
                                 "r is another tape's, or changed: it holds 1 block, 7 "
                                 "bytes; " +
                                 tape + "e tells of 1 block, 6 bytes"));
}

TEST(Verify, ATapeBeingWrittenIsANoteAnd0) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  const auto writer = TapeWriter::create(paths, {"device", "driver"}, {.sync = false});
  ASSERT_TRUE(writer);
  const auto ran = run({"verify", paths.name()});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.out, HasSubstr(": no damage found: "));
  EXPECT_THAT(ran.out, HasSubstr(": note: it is being written"));
  EXPECT_THAT(ran.out, Not(HasSubstr("sound")));
}

TEST(Verify, ATornTailIsANoteAnd0) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {}, {{2, "b"}});
  Bytes torn = test::block_bytes({{1, "abc"}});
  torn.pop_back();
  test::write_file(tape + "r", torn);
  const auto ran = run({"verify", tape});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.out, HasSubstr(": no damage found: 0 read and 1 write"));
  EXPECT_THAT(ran.out, HasSubstr(tape + ": note: " + tape + "r: torn tail at offset 0"));
}

TEST(Verify, DamageIs1WithFileOffsetAndReason) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{2, "a"}, {1, "b"}}, {{2, "b"}}, "junk\n");
  const auto ran = run({"verify", tape});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out, HasSubstr(tape + ": damaged: " + tape + "r is damaged at offset 13: time goes back"));
  EXPECT_THAT(ran.out, HasSubstr(tape + "e is damaged in line 2: not a JSON object"));
}

TEST(Verify, WhatIsNotATapeIs2) {
  const TempDir dir;
  test::write_file(dir / "text.logr", as_bytes("some other log\n"));
  ASSERT_EQ(::mkfifo((dir / "fifo.logr").c_str(), 0600), 0);
  std::filesystem::create_directory(dir / "folder.logr");
  EXPECT_EQ(run({"verify", dir / "text"}).status, 2);
  EXPECT_THAT(run({"verify", dir / "text"}).out, HasSubstr("text.log: not a tape: "));
  EXPECT_EQ(run({"verify", dir / "fifo"}).status, 2);
  EXPECT_EQ(run({"verify", dir / "folder"}).status, 2);
  EXPECT_EQ(run({"verify", dir / "nothing"}).status, 2);
  EXPECT_EQ(run({"verify"}).status, 2);
}

TEST(Verify, SeveralTapesGiveTheWorst) {
  const TempDir dir;
  const std::string good = make_tape(dir, "good", {{1, "a"}}, {});
  const std::string bad = make_tape(dir, "bad", {{2, "a"}, {1, "b"}}, {});
  test::write_file(dir / "text.logr", as_bytes("some other log\n"));
  EXPECT_EQ(run({"verify", good, good}).status, 0);
  EXPECT_EQ(run({"verify", bad, good}).status, 1);
  EXPECT_EQ(run({"verify", dir / "text", bad, good}).status, 2);
}

TEST(Verify, TakesNamesWithADashBehindTwoDashes) {
  EXPECT_THAT(run({"verify", "--", "-x"}).err, HasSubstr("no tape '-x'"));
  EXPECT_THAT(run({"verify", "-x"}).err, HasSubstr("see porttape verify --help"));
}

}  // namespace
}  // namespace porttape
