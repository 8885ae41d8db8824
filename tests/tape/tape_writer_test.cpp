#include "libport/tape/tape_writer.hpp"

#include <csignal>
#include <filesystem>
#include <iterator>
#include <limits>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::Block;
using test::TempDir;
using testing::ElementsAre;
using testing::HasSubstr;

const TapeHeader kHeader{"serial:/dev/ttyUSB0", "pty:/tmp/laser"};

TapeWriter make_writer(const TapePaths& paths, OnExisting on_existing = OnExisting::refuse) {
  auto writer = TapeWriter::create(paths, kHeader, {.on_existing = on_existing, .sync = false});
  if (!writer) throw std::runtime_error(writer.error().message);
  return std::move(*writer);
}

std::vector<std::string> read_tape(const TapePaths& paths) {
  auto reader = TapeReader::open(paths);
  if (!reader) return {"cannot open: " + reader.error().message};
  return test::read_all(*reader);
}

std::string text_of(const std::filesystem::path& path) {
  const Bytes bytes = test::read_file(path);
  return std::string(as_text(bytes));
}

TEST(TapeWriter, AnIndependentDecoderReadsItsBlocks) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.write_block(tape_time_us(26), as_bytes("VV"));
  writer.read_block(tape_time_us(4'000'000'123), as_bytes(std::string_view("\0\xff", 2)));
  writer.write_block(tape_time_us(4'000'000'200), as_bytes("\n"));
  EXPECT_TRUE(writer.finish(tape_time_us(4'000'000'300)));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.write)),
              ElementsAre(Block{26, "VV"}, Block{4'000'000'200, "\n"}));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.read)),
              ElementsAre(Block{4'000'000'123, std::string("\0\xff", 2)}));
  EXPECT_EQ(writer.bytes_written(), 5U);
}

TEST(TapeWriter, OrderAcrossTheFilesIsTheOrderOfCalls) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.event(tape_time_us(0), event::Open{});
  writer.read_block(tape_time_us(0), as_bytes("a"));
  writer.write_block(tape_time_us(0), as_bytes("b"));
  writer.read_block(tape_time_us(0), as_bytes("c"));
  writer.event(tape_time_us(0), event::Mark{"here"});
  writer.read_block(tape_time_us(1), as_bytes("d"));
  writer.event(tape_time_us(1), event::Close{});
  EXPECT_TRUE(writer.finish(tape_time_us(0)));
  EXPECT_THAT(read_tape(paths),
              ElementsAre("open 0", "r 0 a", "w 1 b", "r 2 c", "mark 3", "r 3 d", "close 4", "end 4"));
}

TEST(TapeWriter, NegativeTimesCountAsZero) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.read_block(tape_time_us(-5), as_bytes("a"));
  EXPECT_TRUE(writer.finish(tape_time_us(9)));
  EXPECT_THAT(read_tape(paths), ElementsAre("r 0 a", "end 9"));
}

TEST(TapeWriter, ATimeNoHeaderCanHoldIsALossAndNotAWrongStamp) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.read_block(tape_time_us(4'294'967'295'999'999), as_bytes("a"));
  writer.read_block(tape_time_us(4'294'967'296'000'000), as_bytes("bcd"));
  EXPECT_TRUE(writer.failing());
  EXPECT_EQ(writer.bytes_lost(), 3U);
  EXPECT_FALSE(writer.finish(tape_time_us(4'294'967'296'000'001)));
  EXPECT_THAT(test::decode_independently(test::read_file(paths.read)),
              ElementsAre(Block{4'294'967'295'999'999, "a"}));
}

TEST(TapeWriter, EmptyDataWritesNothing) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.read_block(tape_time_us(1), {});
  EXPECT_TRUE(writer.finish(tape_time_us(2)));
  EXPECT_EQ(test::read_file(paths.read).size(), 0U);
}

TEST(TapeWriter, BlocksAreOnDiskBeforeTheTapeIsFinished) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.read_block(tape_time_us(1), as_bytes("abc"));
  EXPECT_EQ(test::read_file(paths.read).size(), 15U);
}

TEST(TapeWriter, TheDestructorFinishes) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  { make_writer(paths).read_block(tape_time_us(5), as_bytes("x")); }
  EXPECT_THAT(read_tape(paths), ElementsAre("r 5 x", "end 6"));
}

TEST(TapeWriter, WhatComesAfterFinishIsCountedAsLost) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  EXPECT_TRUE(writer.finish(tape_time_us(1)));
  writer.read_block(tape_time_us(2), as_bytes("late"));
  writer.event(tape_time_us(2), event::Mark{"late"});
  EXPECT_EQ(writer.bytes_lost(), 4U);
  EXPECT_THAT(read_tape(paths), ElementsAre("end 1"));
}

TEST(TapeWriter, AChunkOver64KiBIsSeveralBlocks) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  const std::string big(150'000, 'x');
  writer.read_block(tape_time_us(7), as_bytes(big));
  EXPECT_TRUE(writer.finish(tape_time_us(9)));
  const auto blocks = test::decode_independently(test::read_file(paths.read));
  ASSERT_EQ(blocks.size(), 3U);
  EXPECT_EQ(blocks[0].data.size(), 65536U);
  EXPECT_EQ(blocks[2].us, 9);
  EXPECT_EQ(blocks[0].data + blocks[1].data + blocks[2].data, big);
}

TEST(TapeWriter, TheHeaderSaysWhatAndWhere) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeHeader header = kHeader;
  header.created = "2024-05-06T07:08:09.000010Z";
  header.host = "bench\xff\"";
  header.id = "000102030405060708090a0b0c0d0e0f";
  header.zero = TapeZero{"2024-05-06T07:08:09.000005Z", 1234, "b007"};
  header.transport = Transport::stream;
  header.stamped = Stamped::arrival;
  header.previous = PreviousTape{"ff", "s.log"};
  ASSERT_TRUE(TapeWriter::create(paths, header, {}));
  EXPECT_THAT(
      text_of(paths.events),
      HasSubstr(R"({"format":"porttape-events","version":1,"created":"2024-05-06T07:08:09.000010Z",)"
                R"("id":"000102030405060708090a0b0c0d0e0f","zero":{"wall":"2024-05-06T07:08:09.000005Z",)"
                R"("monotonic_us":1234,"boot":"b007"},)"
                R"("device":"serial:/dev/ttyUSB0","driver":"pty:/tmp/laser","transport":"stream",)"
                R"("stamped":"arrival","previous":{"id":"ff","name":"s.log"},"host":"bench)"
                "\xEF\xBF\xBD"
                R"(\"","tool":"porttape )"));
  const auto reader = TapeReader::open(paths);
  ASSERT_TRUE(reader);
  ASSERT_TRUE(reader->header());
  EXPECT_EQ(reader->header()->host, "bench\xEF\xBF\xBD\"");
  EXPECT_EQ(reader->header()->id, header.id);
  EXPECT_EQ(reader->header()->zero, header.zero);
  EXPECT_EQ(reader->header()->transport, header.transport);
  EXPECT_EQ(reader->header()->stamped, header.stamped);
  EXPECT_EQ(reader->header()->previous, header.previous);
}

TEST(TapeWriter, EveryTapeHasAnIdOfItsOwn) {
  const TempDir dir;
  const std::string one = make_writer(literal_tape(dir / "1.log")).id();
  const std::string two = make_writer(literal_tape(dir / "2.log")).id();
  EXPECT_THAT(one, testing::MatchesRegex("[0-9a-f]{32}"));
  EXPECT_NE(one, two);
}

TEST(TapeWriter, TheZeroIsOnBothClocks) {
  ManualClock clock;
  clock.set(Instant{std::chrono::hours(2)});
  const TapeZero now = tape_zero(clock.now(), clock);
  const TapeZero past = tape_zero(clock.now() - std::chrono::hours(1), clock);
  EXPECT_EQ(now.monotonic_us, 7'200'000'000);
  EXPECT_EQ(past.monotonic_us, 3'600'000'000);
  EXPECT_EQ(now.boot, past.boot);
  EXPECT_THAT(now.boot.raw(), testing::MatchesRegex("[0-9a-f-]{36}"));
  EXPECT_EQ(now.wall, "2023-11-15T00:13:20.000000Z");
  EXPECT_EQ(past.wall, "2023-11-14T23:13:20.000000Z");
}

TEST(TapeZeros, OfOneBootAreApartByItsClock) {
  const TapeZero first{"2024-01-01T00:00:00Z", 1'000, "boot"};
  EXPECT_EQ(since(first, {"2000-01-01T00:00:00Z", 3'500, "boot"}), Micros{2'500});
  EXPECT_EQ(since({"", 3'500, "boot"}, first), Micros{-2'500});
  EXPECT_EQ(since(first, {"", std::numeric_limits<std::int64_t>::min(), "boot"}), std::nullopt);
}

TEST(TapeZeros, OthersAreApartByTheWallClock) {
  const auto apart = [](const char* from, const char* to) {
    return since({from, 7, "one"}, {to, 9, "other"});
  };
  EXPECT_EQ(apart("2024-02-28T23:59:59.999999Z", "2024-02-29T00:00:01Z"), Micros{1'000'001});
  EXPECT_EQ(apart("2024-02-29T02:00:00.5+02:00", "2024-02-29T00:00:00Z"), Micros{-500'000});
  EXPECT_EQ(apart("2024-02-28T18:30:00-05:30", "2024-02-29t00:00:00.123456789z"), Micros{123'456});
  EXPECT_EQ(since({"2024-01-01T00:00:00Z", 5, ""}, {"2024-01-01T00:00:01Z", 5, ""}), Micros{1'000'000});
  for (const char* wrong : {"", "2024", "2024-02-30T00:00:00Z", "2024-02-29T24:00:00Z", "2024-02-29T00:00:00",
                            "2024-02-29 x", "2024-02-29T00:00:00+2", "2024-02-29T00:00:00+02:0x",
                            "2024/02/29T00:00:00Z", "-024-02-29T00:00:00Z"}) {
    EXPECT_EQ(apart("2024-02-29T00:00:00Z", wrong), std::nullopt) << wrong;
  }
}

TEST(TapeWriter, TheEndTellsWhatTheFilesHold) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  {
    TapeWriter writer = make_writer(paths);
    writer.event(tape_time_us(1), event::HalfClose{Side::driver});
    writer.read_block(tape_time_us(2), as_bytes("VV"));
    writer.read_block(tape_time_us(3), as_bytes("\n"));
  }
  // The digests are xxhsum's: `printf 'VV\n' | xxhsum -H3`, `printf '' | xxhsum -H3` and `xxhsum -H3 t.logr`.
  const std::string text = text_of(paths.events);
  const std::string end =
      R"({"t_us":4,"event":"end","read":{"blocks":2,"bytes":3,"xxh3":"dffe3986f0f2f0a6","xxh3_all":")"
      "4187a8d0df67827a"
      R"("},"write":{"blocks":0,"bytes":0,"xxh3":"2d06800538d394c2","xxh3_all":"2d06800538d394c2"},)"
      R"("events_xxh3":")";
  const std::size_t begin = text.find(end);
  ASSERT_NE(begin, std::string::npos) << text;
  const std::string before = end + digest_text(digest_of(as_bytes(text.substr(0, begin)))) + '"';
  EXPECT_EQ(text.substr(begin),
            before + R"(,"line_xxh3":")" + digest_text(digest_of(as_bytes(before))) + "\"}\n");
}

TEST(TapeWriter, TheEndCountsOnlyWhatStandsOnTheTape) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeWriter writer = make_writer(paths);
  writer.read_block(tape_time_us(2), as_bytes("kept"));
  writer.read_block(tape_time_us((1LL << 32) * 1'000'000), as_bytes("too late"));
  EXPECT_FALSE(writer.finish(tape_time_us(3)));
  EXPECT_THAT(text_of(paths.events), HasSubstr(R"("end","read":{"blocks":1,"bytes":4,)"));
}

TEST(TapeWriter, CreatedIsFilledInAsUtc) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  make_writer(paths);
  EXPECT_THAT(TapeReader::open(paths)->header()->created.raw(),
              testing::MatchesRegex("[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\\.[0-9]{6}Z"));
}

TEST(TapeWriter, MarksWithAnyBytesStayReadable) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  {
    TapeWriter writer = make_writer(paths);
    writer.event(tape_time_us(1), event::Mark{std::string("\"\\\n\0\x80\xc3\xa9", 7)});
    writer.event(tape_time_us(2), event::Mark{std::string(1'000'000, '\x01')});
  }
  EXPECT_THAT(read_tape(paths), ElementsAre("mark 1", "mark 2", "end 2"));
  EXPECT_THAT(text_of(paths.events), HasSubstr("\"text\":\"\\\"\\\\\\n\\u0000\xEF\xBF\xBD\xc3\xa9\"}"));
}

TEST(TapeFiles, AreReadableByOwnerAndGroupOnly) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  const mode_t before = ::umask(0);
  make_writer(paths);
  ::umask(before);
  for (const auto& path : {paths.read, paths.write, paths.events}) {
    struct stat status {};
    ASSERT_EQ(::stat(path.c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 07777U, 0640U);
  }
}

TEST(TapeFiles, AnExistingTapeIsKeptUnlessToldOtherwise) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  test::write_file(paths.events, as_bytes("old"));
  const auto checked = TapeWriter::check(paths, {});
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().code, Errc::usage);
  EXPECT_THAT(checked.error().message, HasSubstr("--overwrite"));
  EXPECT_FALSE(TapeWriter::create(paths, kHeader, {}));
  EXPECT_EQ(text_of(paths.events), "old");
  EXPECT_FALSE(std::filesystem::exists(paths.read));

  EXPECT_TRUE(TapeWriter::check(paths, {.on_existing = OnExisting::overwrite}));
  make_writer(paths, OnExisting::overwrite);
  EXPECT_THAT(read_tape(paths), ElementsAre("end 0"));
}

TEST(TapeFiles, CheckMakesNothing) {
  const TempDir dir;
  EXPECT_TRUE(TapeWriter::check(literal_tape(dir / "t.log"), {}));
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
}

TEST(TapeFiles, ASymlinkIsRefusedEvenWithOverwrite) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  test::write_file(dir / "precious", as_bytes("keep me"));
  for (const auto& target : {dir / "precious", dir / "nowhere"}) {
    for (const auto& link : {paths.read, paths.write, paths.events}) {
      std::filesystem::create_symlink(target, link);
      for (const OnExisting on_existing : {OnExisting::refuse, OnExisting::overwrite}) {
        EXPECT_EQ(TapeWriter::check(paths, {.on_existing = on_existing}).error().code, Errc::usage);
        EXPECT_FALSE(TapeWriter::create(paths, kHeader, {.on_existing = on_existing}));
      }
      EXPECT_TRUE(std::filesystem::is_symlink(link));
      std::filesystem::remove(link);
    }
  }
  EXPECT_EQ(text_of(dir / "precious"), "keep me");
  EXPECT_FALSE(std::filesystem::exists(dir / "nowhere"));
}

TEST(TapeFiles, OverwriteReplacesOnlyRegularFilesAndOnlyIfAllAre) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  test::write_file(paths.read, as_bytes("old"));
  std::filesystem::create_directory(paths.write);
  EXPECT_FALSE(TapeWriter::create(paths, kHeader, {.on_existing = OnExisting::overwrite}));
  EXPECT_EQ(text_of(paths.read), "old");
}

// No byte may be written to files, as on a full disk.
class FullDisk {
 public:
  FullDisk() {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    handler_ = ::signal(SIGXFSZ, SIG_IGN);
    const rlimit none{0, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &none);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    ::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_{};
  void (*handler_)(int) = SIG_DFL;
};

TEST(TapeFiles, OverwriteThatCannotMakeANewTapeLeavesTheOldOne) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  {
    TapeWriter old = make_writer(paths);
    old.read_block(tape_time_us(5), as_bytes("kept"));
  }
  const std::string before = text_of(paths.read);
  {
    const FullDisk full;
    EXPECT_EQ(TapeWriter::create(paths, kHeader, {.on_existing = OnExisting::overwrite}).error().code,
              Errc::io);
  }
  EXPECT_EQ(text_of(paths.read), before);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(dir.path()), {}), 3);
  EXPECT_TRUE(TapeWriter::create(paths, kHeader, {.on_existing = OnExisting::overwrite}));
  EXPECT_EQ(text_of(paths.read), "");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(dir.path()), {}), 3);
}

TEST(TapeFiles, OverwriteMakesANewFileAndLeavesHardLinksAlone) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  test::write_file(paths.read, as_bytes("old"));
  std::filesystem::create_hard_link(paths.read, dir / "backup");
  make_writer(paths, OnExisting::overwrite);
  EXPECT_EQ(text_of(dir / "backup"), "old");
  EXPECT_EQ(text_of(paths.read), "");
}

TEST(TapeFiles, AMissingFolderIsNamed) {
  const TempDir dir;
  const auto checked = TapeWriter::check(literal_tape(dir / "no/t.log"), {});
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().code, Errc::usage);
  EXPECT_THAT(checked.error().message, HasSubstr("/no"));
  EXPECT_FALSE(TapeWriter::create(literal_tape(dir / "no/t.log"), kHeader, {}));
}

TEST(TapeFiles, ANameTooLongForTheLastFileLeavesNothingBehind) {
  const TempDir dir;
  TapePaths paths = literal_tape(dir / "t.log");
  paths.events = dir / std::string(300, 'x');
  EXPECT_FALSE(TapeWriter::create(paths, kHeader, {}));
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
}

}  // namespace
}  // namespace porttape
