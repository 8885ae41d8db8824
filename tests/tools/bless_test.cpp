#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_writer.hpp"
#include "tests/tools/run.hpp"
#include "tools/write_difference.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

// A tape's writes alone, a letter each.
std::vector<WrittenExchange> writes(const std::string& letters) {
  std::vector<WrittenExchange> all;
  for (const char letter : letters) all.push_back({bytes_of(std::string(1, letter)), {}});
  return all;
}

// "3-" is only on the old tape, "-4" only on the new one, "3/4" on both, with other bytes.
std::string compared(const std::string& one, const std::string& other) {
  std::string out;
  for (const WriteDifference& difference : compare_writes(writes(one), writes(other))) {
    if (!out.empty()) out += ' ';
    if (difference.old_number) out += std::to_string(*difference.old_number);
    out += difference.old_number && difference.new_number ? '/' : '-';
    if (difference.new_number) out += std::to_string(*difference.new_number);
  }
  return out;
}

TEST(WriteDifferences, AreAlignedByWhatIsEqual) {
  EXPECT_EQ(compared("abcd", "abcd"), "");
  EXPECT_EQ(compared("abcd", "abXd"), "3/3");
  EXPECT_EQ(compared("abcd", "abd"), "3-");
  EXPECT_EQ(compared("abcd", "aXbcd"), "-2");
  EXPECT_EQ(compared("abcd", "aXcdY"), "2/2 -5");
  EXPECT_EQ(compared("", "ab"), "-1 -2");
  EXPECT_EQ(compared("ab", ""), "1- 2-");
  EXPECT_EQ(compared("abc", "bca"), "1- -3");
  EXPECT_EQ(compared("aa", "baa"), "-1");
  EXPECT_EQ(compared("aaba", "caa"), "1/1 3-") << "as many as can be are equal";
}

class Bless : public testing::Test {
 protected:
  // Two exchanges.
  Bless()
      : tape(make_tape(dir, "t", {{2000, "42\n"}, {4000, "43\n"}}, {{1000, "ask\n"}, {3000, "more\n"}})) {}

  Ran bless(const std::string& first, const std::string& second, std::vector<std::string> options = {},
            const std::string& behind = "") const {
    options.insert(options.begin(), {"bless", "--tape", tape, "--timeout", "20"});
    options.insert(options.end(), {"--", "/bin/sh", "-c",
                                   "exec 3<>{port}; printf '" + first + "' >&3; read a <&3; printf '" +
                                       second + "' >&3; read b <&3; " + behind});
    return run(options);
  }
  Ran test(const std::string& name, const std::string& first) const {
    return run({"test", "--tape", dir / name, "--timeout", "20", "--", "/bin/sh", "-c",
                "exec 3<>{port}; printf '" + first +
                    "' >&3; read a <&3; printf 'more\\n' >&3; read b <&3; "
                    "test $a$b = 4243"});
  }
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(dir / ""))
      names.push_back(entry.path().filename().string());
    return names;
  }

  TempDir dir;
  std::string tape;
};

TEST_F(Bless, ShowsTheDifferenceAndMakesATapeThatTheChangedDriverPasses) {
  const Ran ran = bless("Ask!\\n", "more\\n");
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("- exchange 1: \"ask\\n\"\n+ exchange 1: \"Ask!\\n\"\n"
                                 "    its recorded answer is kept (3 bytes); whether the device still gives "
                                 "it is not known\n"));
  EXPECT_THAT(ran.out, HasSubstr("t.2.log: 1 of 2 exchanges in "));
  EXPECT_EQ(test("t.2", "Ask!\\n").status, 0) << test("t.2", "Ask!\\n").out;
  EXPECT_EQ(test("t", "ask\\n").status, 0) << "the old tape is another one";
}

TEST_F(Bless, TakesTheOldTapesPlaceOnlyWhenToldTo) {
  const Ran ran = bless("Ask!\\n", "more\\n", {"--overwrite"});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_EQ(test("t", "Ask!\\n").status, 0);
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw", "t.loge"));
}

TEST_F(Bless, TheNewTapeIsOfAllOfTheOldOne) {
  for (const std::vector<std::string>& part : {std::vector<std::string>{"--session", "1"},
                                               {"--start", "0.002"},
                                               {"--end", "0.002"},
                                               {"--loops", "2"},
                                               {"--max-gap", "0"},
                                               {"--rate", "2"},
                                               {"--chunks", "bytes"},
                                               {"--faults", "drop:p=0.5"}}) {
    std::vector<std::string> options = part;
    options.emplace_back("--overwrite");
    EXPECT_EQ(bless("Ask!\\n", "more\\n", options).status, 2) << part.front();
  }
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw"));
}

TEST_F(Bless, ExchangesThatAreNoLongerMadeAreCountedOfThoseThereWere) {
  const Ran ran = run({"bless", "--tape", tape, "--timeout", "20", "--", "/bin/sh", "-c",
                       "exec 3<>{port}; printf 'ask\\n' >&3; read a <&3"});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("1 of 2 exchanges in "));
}

TEST_F(Bless, AnUnchangedDriverNeedsNone) {
  const Ran ran = bless("ask\\n", "more\\n");
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("nothing is to be blessed"));
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw"));
}

TEST_F(Bless, ADriverThatFailsIsNotBlessed) {
  const Ran ran = bless("Ask!\\n", "more\\n", {"--overwrite"}, "exit 7");
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.err, HasSubstr("nothing is blessed"));
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw"));
}

// The new tape would be whole, whatever is missing of the old one.
TEST_F(Bless, ATapeThatIsNotWholeIsNotBlessed) {
  make_tape(dir, "t", {{2000, "42\n"}, {4000, "43\n"}}, {{1000, "ask\n"}, {3000, "more\n"}},
            R"({"event":"gap","t_us":2500,"from_us":2200,"bytes":4,"why":"the disk was full"})"
            "\n");
  const Ran ran = bless("Ask!\\n", "more\\n");
  EXPECT_EQ(ran.status, 1) << ran.out << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("porttape bless: doubt: "));
  EXPECT_THAT(ran.err, HasSubstr("is not whole, and a new tape would not show it"));
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw", "t.loge"));
}

TEST_F(Bless, SeveralConnectionsAreNotBlessedByTheFirst) {
  const Ran ran =
      bless("Ask!\\n", "more\\n", {"--connections", "each", "--driver", "tcp-listen:127.0.0.1:0"});
  EXPECT_EQ(ran.status, 2) << ran.out << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("bless the tape of each connection by itself"));
}

TEST_F(Bless, NothingThatIsThereIsTouched) {
  make_tape(dir, "other", {}, {});
  EXPECT_EQ(bless("x", "y", {"--output", dir / "other"}).status, 2);
  EXPECT_EQ(bless("x", "y", {"--output", dir / "new", "--overwrite"}).status, 2);
  EXPECT_EQ(bless("x", "y", {"--strictness", "2"}).status, 2);
}

TEST_F(Bless, WhatCameIntoBeingWhileTheCommandRanStays) {
  const std::string precious = dir / "t.2.logr";
  const Ran ran = bless("Ask!\\n", "more\\n", {}, "echo precious >'" + precious + "'");
  EXPECT_EQ(ran.status, 2) << ran.out << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("nothing is blessed, and the new tape is gone"));
  EXPECT_EQ(read_file(precious), bytes_of("precious\n"));
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw", "t.2.logr"));
}

TEST_F(Bless, ATapeThatIsBeingWrittenIsRefusedBeforeTheCommandRuns) {
  const auto live = TapeWriter::create(new_tape(tape), {}, {.on_existing = OnExisting::overwrite});
  ASSERT_TRUE(live);
  const Ran ran = bless("Ask!\\n", "more\\n", {"--overwrite"}, "touch '" + (dir / "ran") + "'");
  EXPECT_EQ(ran.status, 2) << ran.out << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("is being written"));
  EXPECT_THAT(files(), testing::UnorderedElementsAre("t.logr", "t.logw", "t.loge"));
}

TEST_F(Bless, WhatIsMadeOfATapeIsForNobodyWhomThatTapeIsNotFor) {
  using std::filesystem::perms;
  for (const std::string letter : {"r", "w"})
    std::filesystem::permissions(tape + letter, perms::owner_read | perms::owner_write);
  EXPECT_EQ(bless("Ask!\\n", "more\\n").status, 0);
  EXPECT_EQ(run({"cut", tape, "--from", "0", "-o", dir / "part"}).status, 0);
  EXPECT_EQ(run({"split", tape, "--every", "1", "-o", dir / "split"}).status, 0);
  EXPECT_EQ(run({"recover", tape, "-o", dir / "sound"}).status, 0);
  EXPECT_EQ(run({"merge", tape, dir / "part", "-o", dir / "both"}).status, 0);
  EXPECT_EQ(run({"convert", tape, "--to", "csv", "-o", dir / "table"}).status, 0);
  EXPECT_EQ(run({"plot", tape, "-o", dir / "picture"}).status, 0);
  EXPECT_EQ(run({"view", tape, "-o", dir / "page"}).status, 0);
  EXPECT_EQ(run({"pack", tape, "-o", dir / "pack.tar.gz"}).status, 0);
  for (const auto& entry : std::filesystem::directory_iterator(dir / "")) {
    EXPECT_EQ(entry.status().permissions(), perms::owner_read | perms::owner_write) << entry.path();
  }
}

TEST_F(Bless, ALinkThatLeadsNowhereTakesAName) {
  std::filesystem::create_symlink("nowhere", dir / "t.2.logw");
  const Ran ran = bless("Ask!\\n", "more\\n");
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("t.3.log: "));
  EXPECT_EQ(bless("Ask!\\n", "more\\n", {"--output", dir / "t.2"}).status, 2);
}

TEST_F(Bless, OnlyWhatItMadeItselfIsTakenAway) {
  const std::string beside = dir / "t.2.log.bless-";
  const Ran ran = bless("Ask!\\n", "more\\n", {}, "echo precious >'" + beside + "'$PPID'w'; exit 7");
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(files(),
              testing::UnorderedElementsAre("t.logr", "t.logw", testing::StartsWith("t.2.log.bless-")));
}

}  // namespace
}  // namespace porttape::test
