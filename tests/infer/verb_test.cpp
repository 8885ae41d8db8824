#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

using test::Block;
using test::make_tape;
using test::run;
using test::TempDir;
using testing::HasSubstr;
using testing::Not;

// A driver that says what time it is, and asks.
std::string record(const TempDir& dir, const std::string& name, int first) {
  std::vector<Block> writes;
  for (int i = 0; i < 6; ++i) {
    writes.push_back({i * 20'000, "TIME " + std::to_string(first + i * 7) + "\r\n"});
    writes.push_back({i * 20'000 + 10'000, "READ?\r\n"});
  }
  return make_tape(dir, name, {}, writes);
}

std::string contents(const std::string& path) {
  const Bytes bytes = test::read_file(path);
  return {bytes.begin(), bytes.end()};
}

TEST(RulesInfer, ToldWhyAndProven) {
  const TempDir dir;
  const auto ran =
      run({"rules", "infer", record(dir, "a", 100), record(dir, "b", 900), "-o", dir / "x.rules"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(ran.out, "");
  EXPECT_THAT(ran.err, HasSubstr("24 lines that end with \"\\r\\n\""));
  EXPECT_THAT(ran.err, HasSubstr("each tape held against each: 4 of 4 pass"));
  EXPECT_THAT(ran.err, HasSubstr("0 not found"));
  EXPECT_THAT(ran.err, HasSubstr("proven      " + (dir / "x.rules")));
  EXPECT_THAT(contents(dir / "x.rules"),
              HasSubstr("# Inferred by porttape from a.log b.log, and proven by them.\n"));
  EXPECT_THAT(contents(dir / "x.rules"), HasSubstr("when = '^TIME '"));
}

TEST(RulesInfer, DashIsStdoutAndWhatIsWrittenThereIsARulesFile) {
  const TempDir dir;
  const std::string tape = record(dir, "a", 100);
  const auto ran = run({"rules", "infer", tape, record(dir, "b", 900), "-o", "-"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  test::write_file(dir / "y.rules", as_bytes(ran.out));
  EXPECT_EQ(run({"rules", "check", tape, dir / "y.rules"}).status, 0);
}

TEST(RulesInfer, AFileIsReplacedOnlyWhenToldTo) {
  const TempDir dir;
  const std::string a = record(dir, "a", 100);
  const std::string b = record(dir, "b", 900);
  test::write_file(dir / "x.rules", as_bytes("mine"));
  const auto refused = run({"rules", "infer", a, b, "-o", dir / "x.rules"});
  EXPECT_EQ(refused.status, 2);
  EXPECT_THAT(refused.err, HasSubstr("x.rules' is there already; name another file, or type --overwrite"));
  EXPECT_EQ(contents(dir / "x.rules"), "mine");
  EXPECT_EQ(run({"rules", "infer", a, b, "-o", dir / "x.rules", "--overwrite"}).status, 0);
  EXPECT_THAT(contents(dir / "x.rules"), HasSubstr("porttape-rules"));
}

TEST(RulesInfer, TapesOfDifferentDriversAreNotProvenAnd3) {
  const TempDir dir;
  const std::string other = make_tape(dir, "b", {}, {{1, "alpha"}, {20'000, "beta 7 and more"}});
  const auto ran = run({"rules", "infer", record(dir, "a", 100), other, "-o", "-"});
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out, HasSubstr("NOT PROVEN"));
  EXPECT_THAT(ran.err, Not(HasSubstr("\nproven")));
}

TEST(RulesInfer, TapesThatDoNotDifferNeedNoRulesAndNoFile) {
  const TempDir dir;
  const std::string a = record(dir, "a", 100);
  const std::string b = record(dir, "b", 100);
  const auto ran = run({"rules", "infer", a, b, "-o", dir / "x.rules"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(ran.out, "");
  EXPECT_EQ(ran.err, "no rules    the driver wrote the same in all tapes: no file is written\n");
  EXPECT_FALSE(fs::exists(dir / "x.rules"));
  const auto piped = run({"rules", "infer", a, b, "-o", "-"});
  EXPECT_EQ(piped.status, 0) << piped.err;
  EXPECT_EQ(piped.out, "");
  EXPECT_EQ(piped.err, "no rules    the driver wrote the same in all tapes: nothing is written\n");
}

TEST(RulesInfer, AnOlderFileStaysWhereNoRulesAreNeeded) {
  const TempDir dir;
  test::write_file(dir / "x.rules", as_bytes("mine"));
  const auto ran = run(
      {"rules", "infer", record(dir, "a", 100), record(dir, "b", 100), "-o", dir / "x.rules", "--overwrite"});
  EXPECT_EQ(ran.status, 0) << ran.err;
  EXPECT_EQ(contents(dir / "x.rules"), "mine");
}

TEST(RulesInfer, WhatIsWrittenIsARulesFileHoweverBadTheProof) {
  const TempDir dir;
  const std::string a = make_tape(dir, "a", {}, {{1, "alpha"}});
  const std::string b = make_tape(dir, "b", {}, {{1, "beta 7 and more"}});
  EXPECT_EQ(run({"rules", "infer", a, b, "-o", dir / "x.rules"}).status, 3);
  EXPECT_NE(run({"rules", "check", a, dir / "x.rules"}).status, 2) << contents(dir / "x.rules");
}

TEST(RulesInfer, WrongUseIs2) {
  const TempDir dir;
  const std::string a = record(dir, "a", 100);
  const std::string none = make_tape(dir, "none", {{1, "x"}}, {});
  EXPECT_THAT(run({"rules", "infer", a, "-o", "-"}).err, HasSubstr("one tape shows nothing that differs"));
  EXPECT_THAT(run({"rules", "infer", a, a}).err, HasSubstr("'output' is missing: RULES"));
  EXPECT_THAT(run({"rules", "infer", a, a, "-o", "-", "--changes", "0"}).err,
              HasSubstr("'changes': '0'; accepted: 1 to"));
  EXPECT_THAT(run({"rules", "infer", a, none, "-o", "-"}).err, HasSubstr("has nothing that a driver wrote"));
  const auto no_folder = run({"rules", "infer", a, a, "-o", dir / "no/x.rules"});
  EXPECT_EQ(no_folder.status, 2);
  EXPECT_THAT(no_folder.err, HasSubstr("rules file"));
}

}  // namespace
}  // namespace porttape
