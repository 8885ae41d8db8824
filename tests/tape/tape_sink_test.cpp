#include "libport/tape/tape_sink.hpp"

#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <filesystem>
#include <memory>
#include <string>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_batch.hpp"
#include "libport/tape/tape_lock.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::TempDir;
using testing::ElementsAre;

std::string text_in(const std::string& path) {
  const Bytes bytes = test::read_file(path);
  return std::string(as_text(bytes));
}

class FileSinkTest : public testing::Test {
 protected:
  FileSinkTest() : folder(::open(dir.path().c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC)) {}

  TempDir dir;
  UniqueFd folder;
  int error = -1;
};

TEST_F(FileSinkTest, MakesALockedFileAndAppends) {
  const auto sink = FileSink::create(folder.get(), "f", error);
  ASSERT_TRUE(sink);
  EXPECT_EQ(error, 0);
  EXPECT_TRUE(is_being_written(std::filesystem::path(dir / "f")));
  const TapeSink::Appended both = sink->append(as_bytes("head"), as_bytes("body"));
  EXPECT_EQ(both.bytes, 8U);
  EXPECT_EQ(both.error, 0);
  EXPECT_EQ(sink->append({}, as_bytes("more")).bytes, 4U);
  EXPECT_EQ(sink->append({}, {}).bytes, 0U);
  EXPECT_EQ(text_in(dir / "f"), "headbodymore");
  EXPECT_EQ(sink->truncate(6), 0);
  sink->append(as_bytes("!"), {});
  EXPECT_EQ(text_in(dir / "f"), "headbo!");
  EXPECT_EQ(sink->syncer()(), 0);
  EXPECT_EQ(sink->close(), 0);
  EXPECT_FALSE(is_being_written(std::filesystem::path(dir / "f")));
  EXPECT_EQ(sink->close(), EBADF);
  EXPECT_EQ(sink->truncate(0), EBADF);
  const TapeSink::Appended closed = sink->append(as_bytes("x"), {});
  EXPECT_EQ(closed.bytes, 0U);
  EXPECT_EQ(closed.error, EBADF);
}

TEST_F(FileSinkTest, TakesNoNameThatIsTaken) {
  test::write_file(dir / "f", test::bytes_of("old"));
  std::filesystem::create_symlink("nowhere", dir / "link");
  for (const char* name : {"f", "link"}) {
    error = 0;
    EXPECT_FALSE(FileSink::create(folder.get(), name, error));
    EXPECT_EQ(error, EEXIST) << name;
  }
  EXPECT_EQ(text_in(dir / "f"), "old");
  EXPECT_FALSE(FileSink::create(folder.get(), "no/f", error));
  EXPECT_EQ(error, ENOENT);
}

TEST_F(FileSinkTest, ASyncTellsThatTheNameIsLostAndNothingOnceTheSinkIsClosed) {
  const auto sink = FileSink::create(folder.get(), "f", error);
  ASSERT_TRUE(sink);
  const TapeSink::Sync sync = sink->syncer();
  EXPECT_EQ(sync(), 0);
  std::filesystem::remove(dir / "f");
  EXPECT_EQ(sync(), ENOENT);
  EXPECT_EQ(sink->close(), 0);
  EXPECT_EQ(sync(), 0);
}

TEST_F(FileSinkTest, WithoutANameItGetsOneLaterOrGoesAway) {
  const auto sink = FileSink::create_unnamed(folder.get(), error);
  if (!sink && error == EOPNOTSUPP) GTEST_SKIP() << "this file system has no files without names";
  ASSERT_TRUE(sink);
  EXPECT_EQ(error, 0);
  EXPECT_EQ(sink->append(as_bytes("a"), as_bytes("b")).bytes, 2U);
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  EXPECT_EQ(sink->syncer()(), ENOENT);
  EXPECT_EQ(sink->link(folder.get(), "f"), 0);
  EXPECT_EQ(text_in(dir / "f"), "ab");
  EXPECT_EQ(sink->link(folder.get(), "f"), EEXIST);
  EXPECT_EQ(sink->syncer()(), 0);
  struct stat status {};
  ASSERT_EQ(::stat((dir / "f").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 07137U, 0U);
  const UniqueFd gone(::open(".", O_PATH | O_CLOEXEC));
  EXPECT_EQ(sink->link(gone.get(), "no/f"), ENOENT);
}

TEST_F(FileSinkTest, WhereNoFileCanBeMadeTheErrorIsTold) {
  EXPECT_FALSE(FileSink::create_unnamed(-1, error));
  EXPECT_EQ(error, EBADF);
  EXPECT_FALSE(FileSink::create(-1, "f", error));
  EXPECT_EQ(error, EBADF);
}

TEST_F(FileSinkTest, WithoutASecondDescriptorNothingIsLeft) {
  const int next = ::dup(folder.get());  // the lowest that is free
  ASSERT_EQ(::close(next), 0);
  const auto limit = static_cast<rlim_t>(next) + 1;
  const int here = folder.get();
  for (const bool named : {false, true}) {
    int failure = 0;
    std::unique_ptr<FileSink> sink;
    {
      const test::DescriptorLimit one(limit);
      sink = named ? FileSink::create(here, "f", failure) : FileSink::create_unnamed(here, failure);
    }
    EXPECT_FALSE(sink) << named;
    EXPECT_EQ(failure, EMFILE) << named;
  }
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
}

TEST_F(FileSinkTest, ADiskThatTakesAPartTellsWhyAndHowMuch) {
  const auto sink = FileSink::create(folder.get(), "f", error);
  ASSERT_TRUE(sink);
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  auto* const handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const rlim_t room : {3U, 4U, 6U}) {
    ASSERT_EQ(sink->truncate(0), 0);
    const rlimit limit{room, before.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const TapeSink::Appended done = sink->append(as_bytes("head"), as_bytes("body"));
    ::setrlimit(RLIMIT_FSIZE, &before);
    EXPECT_EQ(done.bytes, room);
    EXPECT_EQ(done.error, EFBIG);
    EXPECT_EQ(text_in(dir / "f"), std::string("headbody").substr(0, room));
  }
  std::signal(SIGXFSZ, handler);
}

// A disk whose calls are written down; a test says what each append takes.
struct Script {
  std::vector<TapeSink::Appended> appends;  // of the next ones; then all goes in
  std::vector<int> truncations;             // their errors; then none
  std::vector<std::string> calls;
};

class ScriptedSink final : public TapeSink {
 public:
  explicit ScriptedSink(Script& script) : script_(script) {}
  Appended append(ByteView head, ByteView body) override {
    script_.calls.push_back("append " + std::string(as_text(head)) + "|" + std::string(as_text(body)));
    if (script_.appends.empty()) return {head.size() + body.size(), 0};
    const Appended done = script_.appends.front();
    script_.appends.erase(script_.appends.begin());
    return done;
  }
  int truncate(std::uint64_t size) override {
    script_.calls.push_back("truncate " + std::to_string(size));
    if (script_.truncations.empty()) return 0;
    const int error = script_.truncations.front();
    script_.truncations.erase(script_.truncations.begin());
    return error;
  }
  Sync syncer() override {
    return [] { return 0; };
  }
  int close() override { return 0; }

 private:
  Script& script_;
};

class WholeAppenderTest : public testing::Test {
 protected:
  Script script;
  WholeAppender file{std::make_unique<ScriptedSink>(script)};
};

TEST_F(WholeAppenderTest, WhatGoesInWhollyCounts) {
  EXPECT_EQ(file.append(as_bytes("ab"), as_bytes("cd")), 0);
  EXPECT_EQ(file.append({}, as_bytes("e")), 0);
  EXPECT_EQ(file.repair(), 0);
  EXPECT_THAT(script.calls, ElementsAre("append ab|cd", "append |e"));
}

TEST_F(WholeAppenderTest, APartIsTakenBackAtOnce) {
  EXPECT_EQ(file.append(as_bytes("ab"), as_bytes("cd")), 0);
  script.appends = {{1, EIO}, {3, 0}, {0, ENOSPC}, {4, EIO}};
  EXPECT_EQ(file.append(as_bytes("ab"), as_bytes("cd")), EIO);
  EXPECT_EQ(file.append(as_bytes("ab"), as_bytes("cd")), ENOSPC) << "less than all, without a reason";
  EXPECT_EQ(file.append(as_bytes("ab"), as_bytes("cd")), ENOSPC);
  EXPECT_EQ(file.append(as_bytes("ab"), as_bytes("cd")), EIO);
  EXPECT_THAT(script.calls, ElementsAre("append ab|cd", "append ab|cd", "truncate 4", "append ab|cd",
                                        "truncate 4", "append ab|cd", "append ab|cd", "truncate 4"));
}

TEST_F(WholeAppenderTest, WhatCannotBeTakenBackIsTriedAgainBeforeAnythingIsWritten) {
  script.appends = {{1, EIO}};
  script.truncations = {EROFS, EROFS, EROFS};
  EXPECT_EQ(file.append({}, as_bytes("ab")), EIO);
  EXPECT_EQ(file.append({}, as_bytes("cd")), EROFS);
  const std::vector<std::size_t> ends{2};
  const auto kept = file.append_parts(as_bytes("ef"), ends);
  EXPECT_EQ(kept.parts, 0U);
  EXPECT_EQ(kept.error, EROFS);
  EXPECT_EQ(file.append({}, as_bytes("gh")), 0);
  EXPECT_THAT(script.calls, ElementsAre("append |ab", "truncate 0", "truncate 0", "truncate 0", "truncate 0",
                                        "append |gh"));
}

TEST_F(WholeAppenderTest, OfSeveralPartsTheWholeOnesThatWentInAreKept) {
  const std::vector<std::size_t> ends{2, 5, 6};
  struct Case {
    TapeSink::Appended done;
    std::size_t parts;
    int error;
    std::string truncated;
  };
  std::uint64_t size = 0;
  for (const Case& each : {Case{{6, 0}, 3, 0, ""}, Case{{0, EIO}, 0, EIO, ""}, Case{{1, EIO}, 0, EIO, "0"},
                           Case{{2, EIO}, 1, EIO, ""}, Case{{4, EIO}, 1, EIO, "2"},
                           Case{{5, 0}, 2, ENOSPC, ""}, Case{{6, EIO}, 3, 0, ""}}) {
    script = {{each.done}, {}, {}};
    const auto kept = file.append_parts(as_bytes("abcdef"), ends);
    EXPECT_EQ(kept.parts, each.parts) << each.done.bytes;
    EXPECT_EQ(kept.error, each.error) << each.done.bytes;
    std::vector<std::string> calls{"append |abcdef"};
    if (!each.truncated.empty())
      calls.push_back("truncate " + std::to_string(size + std::stoul(each.truncated)));
    EXPECT_EQ(script.calls, calls) << each.done.bytes;
    size += each.parts == 0 ? 0 : ends[each.parts - 1];
  }
}

TEST_F(WholeAppenderTest, ABatchKnowsThePayloadOfEachBlock) {
  TapeBatch batch;
  TapeBatch::Blocks& blocks = batch.of(Direction::write);
  EXPECT_EQ(&blocks, &batch.write);
  EXPECT_EQ(&batch.of(Direction::read), &batch.read);
  blocks.write(file);
  EXPECT_TRUE(script.calls.empty());
  blocks.add(5, as_bytes("H1"), as_bytes("one"));
  blocks.add(6, as_bytes("H22"), as_bytes("three"));
  blocks.add(7, as_bytes("H3"), as_bytes("x"));
  script.appends = {{13, EIO}};
  blocks.write(file);
  EXPECT_THAT(script.calls, ElementsAre("append |H1oneH22threeH3x"));
  EXPECT_EQ(blocks.kept.parts, 2U);
  EXPECT_EQ(blocks.kept.error, EIO);
  EXPECT_EQ(as_text(blocks.payload(0)), "one");
  EXPECT_EQ(as_text(blocks.payload(1)), "three");
  EXPECT_EQ(as_text(blocks.payload(2)), "x");
  EXPECT_EQ(blocks.blocks[1].us, 6);
}

}  // namespace
}  // namespace porttape
