#include "libport/taped/tape_group.hpp"

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <sys/stat.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "libport/taped/tape_keeper.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

class TapeGroupTest : public testing::Test {
 protected:
  void make(OnExisting on_existing) {
    group = std::make_shared<TapeGroup>(new_tape(dir / "laser"), on_existing, machine_clock());
  }
  // A tape that is complete.
  Result<void> tape(unsigned part, unsigned connection) {
    Result<TapeWriter> writer = group->make(part, connection, header());
    if (!writer) return writer.error();
    return writer->finish(TapeTime{});
  }
  // Of this group: its zero tells.
  TapeHeader header() {
    return {.device = "memory", .driver = "test", .zero = group->begin(machine_clock().now()).header_zero};
  }
  void file(const std::string& name) { test::write_file(dir / name, {}); }
  [[nodiscard]] unsigned mode_of(const std::string& name) const {
    struct stat status {};
    return ::stat((dir / name).c_str(), &status) == 0 ? status.st_mode & 0777U : 0U;
  }
  // The r files, without the letter.
  [[nodiscard]] std::set<std::string> tapes() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(dir.path())) {
      std::string name = entry.path().filename().string();
      if (!name.ends_with('r')) continue;
      name.pop_back();
      names.insert(name);
    }
    return names;
  }
  using Names = std::set<std::string>;

  test::TempDir dir;
  std::shared_ptr<TapeGroup> group;
};

TEST_F(TapeGroupTest, TheFirstConnectionsOpenIsTheZeroOfAll) {
  make(OnExisting::refuse);
  const Instant first = Instant{} + std::chrono::hours(1);
  const TapeGroup::Part one = group->begin(first);
  const TapeGroup::Part two = group->begin(first + std::chrono::seconds(3));
  EXPECT_EQ(one.zero, first);
  EXPECT_EQ(two.zero, first);
  EXPECT_EQ(one.header_zero, two.header_zero);
  EXPECT_EQ(two.number, 1U);
}

TEST_F(TapeGroupTest, ARotationIsOneForAll) {
  make(OnExisting::refuse);
  const Instant first = Instant{} + std::chrono::hours(1);
  const Instant later = first + std::chrono::minutes(1);
  group->rotate(first);  // nobody has come
  EXPECT_EQ(group->begin(first).number, 1U);
  EXPECT_EQ(group->next(1, later).number, 2U);
  EXPECT_EQ(group->next(1, later + std::chrono::milliseconds(1)).zero, later);  // another connection's
  EXPECT_EQ(group->begin(later + std::chrono::seconds(1)).number, 2U);
  group->rotate(later + std::chrono::seconds(2));
  EXPECT_EQ(group->begin(later + std::chrono::seconds(3)).number, 3U);
}

TEST_F(TapeGroupTest, PartsAndConnectionsHaveTheirNames) {
  make(OnExisting::refuse);
  ASSERT_TRUE(group->check().has_value());
  for (const auto& [part, connection] : {std::pair{1U, 1U}, {1U, 2U}, {2U, 2U}, {2U, 3U}})
    ASSERT_TRUE(tape(part, connection).has_value());
  EXPECT_EQ(tapes(), (Names{"laser.log", "laser.c2.log", "laser.2.c2.log", "laser.2.c3.log"}));
}

TEST_F(TapeGroupTest, RefuseIsAboutEveryNameOfTheGroup) {
  file("laser.c7.loge");
  make(OnExisting::refuse);
  const Result<void> checked = group->check();
  ASSERT_FALSE(checked.has_value());
  EXPECT_EQ(checked.error().code, Errc::usage);
  EXPECT_NE(checked.error().message.find("laser.c7.log"), std::string::npos) << checked.error().message;
  EXPECT_FALSE(tape(1, 1).has_value());  // one that came in the meantime
  EXPECT_EQ(tapes(), Names{});
}

TEST_F(TapeGroupTest, NextTakesANumberOfWhichNothingIsThere) {
  file("laser.logr");
  file("laser.2.c5.logr");
  make(OnExisting::next);
  ASSERT_TRUE(group->check().has_value());
  ASSERT_TRUE(tape(1, 2).has_value());
  ASSERT_TRUE(tape(1, 1).has_value());
  ASSERT_TRUE(tape(2, 1).has_value());
  EXPECT_EQ(tapes(), (Names{"laser.log", "laser.2.c5.log", "laser.3.log", "laser.3.c2.log", "laser.4.log"}));
}

TEST_F(TapeGroupTest, OverwriteLeavesNothingOfTheOlderGroup) {
  make(OnExisting::refuse);
  for (const unsigned connection : {1U, 2U, 3U}) ASSERT_TRUE(tape(1, connection).has_value());
  file("laser.2.logr");  // of another part
  make(OnExisting::overwrite);
  ASSERT_TRUE(group->check().has_value());
  ASSERT_TRUE(tape(1, 2).has_value());
  EXPECT_EQ(tapes(), (Names{"laser.c2.log", "laser.2.log"}));
  ASSERT_TRUE(tape(1, 1).has_value());
  EXPECT_EQ(tapes(), (Names{"laser.log", "laser.c2.log", "laser.2.log"}));
}

TEST_F(TapeGroupTest, WhatReplacesAStricterGroupIsAsStrict) {
  for (const std::string strict : {"laser.logr", "laser.c2.loge"}) {
    make(OnExisting::overwrite);
    for (const unsigned connection : {1U, 2U}) ASSERT_TRUE(tape(1, connection).has_value());
    EXPECT_EQ(mode_of("laser.c2.logw"), 0640U) << "before " << strict;
    ASSERT_EQ(::chmod((dir / strict).c_str(), 0600), 0);
    make(OnExisting::overwrite);
    for (const unsigned connection : {3U, 1U, 2U}) ASSERT_TRUE(tape(1, connection).has_value());
    for (const std::string name : {"laser", "laser.c2", "laser.c3"}) {
      for (const char* const letter : {"r", "w", "e"})
        EXPECT_EQ(mode_of(name + ".log" + letter), 0600U) << name << letter << ' ' << strict;
    }
    ASSERT_TRUE(tape(2, 1).has_value());
    EXPECT_EQ(mode_of("laser.2.logr"), 0640U) << "it replaces nothing";
    for (const auto& entry : std::filesystem::directory_iterator(dir.path()))
      std::filesystem::remove(entry.path());
  }
}

TEST_F(TapeGroupTest, OverwriteTouchesNothingWhereATapeIsNotOfTheGroup) {
  make(OnExisting::refuse);
  ASSERT_TRUE(tape(1, 7).has_value());  // with a zero of its own
  for (const std::string name : {"laser.c7.log", "laser.c2.log"}) {
    make(OnExisting::next);
    const TapeHeader other = header();
    ASSERT_TRUE(TapeWriter::create(new_tape(dir / "laser"), other, {.on_existing = OnExisting::overwrite})
                    ->finish(TapeTime{})
                    .has_value());
    const Names before = tapes();
    make(OnExisting::overwrite);
    const Result<void> checked = group->check();
    ASSERT_FALSE(checked.has_value());
    EXPECT_EQ(checked.error().code, Errc::usage);
    EXPECT_EQ(checked.error().message, "cannot make the tape: '" + (dir / name) +
                                           "' is not of the recording '" + (dir / "laser.log") +
                                           "', which is to be replaced; move it, or take another name");
    EXPECT_FALSE(tape(1, 1).has_value());
    EXPECT_EQ(tapes(), before);
    for (const char* const letter : {"r", "w", "e"}) {
      std::filesystem::remove(dir / ("laser.c7.log" + std::string(letter)));
      file("laser.c2.log" + std::string(letter));  // of which nothing tells what it is of
    }
  }
}

TEST_F(TapeGroupTest, OverwriteReplacesATapeThatSaysNothingOfItself) {
  file("laser.logr");
  file("laser.logw");
  make(OnExisting::overwrite);
  EXPECT_TRUE(group->check().has_value());
  ASSERT_TRUE(tape(1, 1).has_value());
  EXPECT_EQ(tapes(), Names{"laser.log"});
}

TEST_F(TapeGroupTest, AGroupThatIsBeingWrittenIsNotReplaced) {
  make(OnExisting::refuse);
  ASSERT_TRUE(tape(1, 1).has_value());
  const Result<TapeWriter> live = group->make(1, 2, header());
  ASSERT_TRUE(live.has_value());
  make(OnExisting::overwrite);
  EXPECT_FALSE(group->check().has_value());
  EXPECT_FALSE(tape(1, 1).has_value());
  EXPECT_EQ(tapes(), (Names{"laser.log", "laser.c2.log"}));
}

TEST_F(TapeGroupTest, AKeeperOfAGroupCountsFromItsZero) {
  make(OnExisting::refuse);
  Loop loop;
  const LogBook book;
  const auto keep = [&](unsigned connection) {
    return std::make_unique<TapeKeeper>(PortContext{&loop, book.log()},
                                        TapeKeeper::Options{.tape = group->tape_of(connection),
                                                            .header = {.device = "memory", .driver = "test"},
                                                            .group = group,
                                                            .connection = connection},
                                        [] {});
  };
  const Instant first = loop.now();
  const auto one = keep(1);
  const auto two = keep(2);
  EXPECT_TRUE(one->check().has_value());
  one->opened(first);
  two->opened(first + std::chrono::milliseconds(1500));
  two->block(Direction::write, first + std::chrono::milliseconds(1600), as_bytes("x"));
  int complete = 0;
  for (const auto& keeper : {&one, &two})
    (*keeper)->finish(first + std::chrono::seconds(2), [&complete](bool all) { complete += all ? 1 : 0; });
  run_until(loop, [&complete] { return complete == 2; });
  Result<TapeReader> reader = TapeReader::open(new_tape(dir / "laser.c2"));
  ASSERT_TRUE(reader.has_value());
  std::optional<TapeTime> opened;
  std::optional<TapeTime> written;
  for (auto record = reader->next(); record && *record; record = reader->next()) {
    if ((*record)->kind == RecordKind::open) opened = (*record)->at;
    if ((*record)->kind == RecordKind::write) written = (*record)->at;
  }
  EXPECT_EQ(opened, tape_time_us(1'500'000));
  EXPECT_EQ(written, tape_time_us(1'600'000));
  Result<TapeReader> other = TapeReader::open(new_tape(dir / "laser"));
  ASSERT_TRUE(other.has_value());
  EXPECT_EQ(other->header()->zero, reader->header()->zero);
  EXPECT_EQ(other->header()->zero, group->begin(first).header_zero);
}

TEST_F(TapeGroupTest, KeepersOfAGroupGoOnWithTheSameNextPart) {
  make(OnExisting::refuse);
  Loop loop;
  const LogBook book;
  std::vector<std::unique_ptr<TapeKeeper>> keepers;
  const Instant first = loop.now();
  for (const unsigned connection : {1U, 2U}) {
    keepers.push_back(
        std::make_unique<TapeKeeper>(PortContext{&loop, book.log()},
                                     TapeKeeper::Options{.tape = group->tape_of(connection),
                                                         .header = {.device = "memory", .driver = "test"},
                                                         .group = group,
                                                         .connection = connection},
                                     [] {}));
    keepers.back()->opened(first);
  }
  for (int minutes = 1; minutes <= 2; ++minutes) {
    for (const auto& keeper : keepers)
      EXPECT_TRUE(keeper->request(first + std::chrono::minutes(minutes), RecorderRequest::next_tape()));
  }
  int complete = 0;
  for (const auto& keeper : keepers)
    keeper->finish(first + std::chrono::minutes(3), [&complete](bool all) { complete += all ? 1 : 0; });
  run_until(loop, [&complete] { return complete == 2; });
  EXPECT_EQ(tapes(), (Names{"laser.log", "laser.c2.log", "laser.2.log", "laser.2.c2.log", "laser.3.log",
                            "laser.3.c2.log"}));
}

}  // namespace
}  // namespace porttape
