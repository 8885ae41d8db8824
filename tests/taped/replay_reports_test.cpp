// How long the report of a run waits for what is found out about it.

#include "libport/taped/replay_reports.hpp"

#include <cstdint>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <sys/stat.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class ReplayReportsTest : public testing::Test {
 protected:
  static constexpr Nanos kMoment = std::chrono::microseconds(1);

  // Of a tape that nobody reads to its end meanwhile: 1.5 GiB of empty blocks in each file.
  void begin_on_a_huge_tape(const std::optional<TapeTotals>& totals = {}) {
    for (const char* file : {"t.logr", "t.logw"}) {
      test::write_file(dir / file, ByteView{});
      std::filesystem::resize_file(dir / file, std::uintmax_t{3} << 29);
    }
    begin(totals);
  }
  void begin(const std::optional<TapeTotals>& totals) {
    ReplayReports::Options options;
    options.tape = literal_tape(dir / "t.log");
    options.totals = totals;
    options.file = report_file;
    options.junit_file = junit_file;
    reports =
        std::make_unique<ReplayReports>(PortContext{&loop, book.log()}, std::move(options),
                                        [this](const RunReport& report) { published.push_back(report); });
  }
  static RunReport failed(const Mismatch& mismatch) {
    RunReport report;
    report.verdict = Verdict::data_mismatch;
    report.mismatch = mismatch;
    return report;
  }
  // Lets time pass without waiting for other threads.
  void pass(Nanos time) {
    clock.pass(time);
    loop.clock_moved();
    loop.restart();
    while (loop.poll_one()) {
    }
  }

  test::TempDir dir;
  ManualClock clock;
  Loop loop{clock};
  LogBook book;
  std::string report_file;
  std::string junit_file;
  std::vector<RunReport> published;
  std::unique_ptr<ReplayReports> reports;
};

TEST_F(ReplayReportsTest, TheCountIsWaitedForUntilItsLimit) {
  begin_on_a_huge_tape();
  reports->add({});
  pass(ReplayReports::kCountLimit - kMoment);
  EXPECT_THAT(published, IsEmpty());
  pass(kMoment);
  ASSERT_THAT(published, SizeIs(1));
  EXPECT_EQ(published[0].to_driver_of, std::nullopt);
}

TEST_F(ReplayReportsTest, AnEndLeavesTimeForTheFile) {
  begin_on_a_huge_tape();
  reports->add({});
  std::optional<bool> written;
  const Nanos left = std::chrono::seconds(3);
  reports->finish(clock.now() + left, [&written](bool all) { written = all; });
  pass(left - ReplayReports::kFileTime - kMoment);
  EXPECT_THAT(published, IsEmpty());
  EXPECT_EQ(written, std::nullopt);
  pass(kMoment);
  EXPECT_THAT(published, SizeIs(1));
  EXPECT_EQ(written, true);
}

TEST_F(ReplayReportsTest, TheHintIsWaitedForUntilItsLimit) {
  begin_on_a_huge_tape(TapeTotals{});
  Mismatch mismatch;
  mismatch.got = test::bytes_of("x");
  reports->look_for_hint(mismatch);
  reports->add(failed(mismatch));
  pass(ReplayReports::kHintLimit - kMoment);
  EXPECT_THAT(published, IsEmpty());
  pass(kMoment);
  ASSERT_THAT(published, SizeIs(1));
  EXPECT_THAT(published[0].mismatch->hint, HasSubstr("not known"));
}

TEST_F(ReplayReportsTest, OnceTheyAreGoneNobodyReadsTheTapeForThem) {
  // What this process has read from files so far.
  const auto read_so_far = [] {
    std::ifstream io("/proc/self/io");
    std::string name;
    std::uintmax_t bytes = 0;
    return io >> name >> bytes ? bytes : 0;
  };
  if (read_so_far() == 0) GTEST_SKIP() << "this system does not tell what a process has read";
  begin_on_a_huge_tape(TapeTotals{});
  Mismatch mismatch;
  mismatch.got = test::bytes_of("x");
  reports->look_for_hint(mismatch);
  reports->add(failed(mismatch));
  const std::uintmax_t before = read_so_far();
  reports.reset();
  settle(loop);
  EXPECT_LT(read_so_far() - before, std::filesystem::file_size(dir / "t.logw"));
}

TEST_F(ReplayReportsTest, TheCauseIsWaitedForUntilItsLimit) {
  begin_on_a_huge_tape(TapeTotals{});
  reports->add(failed({}));
  pass(ReplayReports::kHintLimit - kMoment);
  EXPECT_THAT(published, IsEmpty());
  pass(kMoment);
  ASSERT_THAT(published, SizeIs(1));
  EXPECT_FALSE(published[0].diagnosis.cause.has_value());
}

TEST_F(ReplayReportsTest, ReportsAreInTheOrderOfTheirRuns) {
  begin_on_a_huge_tape(TapeTotals{});
  reports->add(failed({}));
  RunReport second;
  second.tape = "second";
  reports->add(second);
  pass(ReplayReports::kHintLimit - kMoment);
  EXPECT_THAT(published, IsEmpty()) << "the second waits for the first";
  pass(kMoment);
  ASSERT_THAT(published, SizeIs(2));
  EXPECT_EQ(published[1].tape, "second");
}

// A tape that has what came instead of its first write.
class HintsOfARun : public ReplayReportsTest {
 protected:
  HintsOfARun() {
    test::write_file(dir / "t.logw", test::block_bytes({{0, "one\n"}, {10, "two\n"}}));
    begin(TapeTotals{0, 8});
  }
  void mismatches(std::size_t count, MismatchKind kind = MismatchKind::data) {
    Mismatch mismatch;
    mismatch.kind = kind;
    mismatch.got = test::bytes_of("two\n");
    for (std::size_t i = 0; i < count; ++i) {
      mismatch.offset = i;
      reports->look_for_hint(mismatch);
    }
    settle(loop);
  }
  [[nodiscard]] std::size_t told() const {
    const std::string text = book.text();
    std::size_t count = 0;
    for (std::size_t at = text.find("comes later"); at != std::string::npos;
         at = text.find("comes later", at + 1))
      ++count;
    return count;
  }
};

TEST_F(HintsOfARun, AreOfItsFirstMismatches) {
  mismatches(ReplayReports::kMostHints);
  EXPECT_EQ(told(), ReplayReports::kMostHints);
  mismatches(1);
  EXPECT_EQ(told(), ReplayReports::kMostHints);
}

TEST_F(HintsOfARun, SayWhoseBytesTheyAreOf) {
  mismatches(2);
  for (const char* const byte : {"0", "1"})
    EXPECT_THAT(book.text(), HasSubstr(fmt::format("t.log: what the driver wrote at byte {} is ", byte)));
}

TEST_F(HintsOfARun, AreInItsReportAsSoonAsTheyAreFound) {
  Mismatch mismatch;
  mismatch.got = test::bytes_of("two\n");
  reports->look_for_hint(mismatch);
  RunReport report = failed(mismatch);
  report.verdict = Verdict::incomplete;  // so that no cause is looked for
  reports->add(std::move(report));
  EXPECT_THAT(published, IsEmpty());
  run_until(loop, [this] { return !published.empty(); });
  EXPECT_THAT(published.at(0).mismatch->hint, HasSubstr("comes later"));
}

TEST_F(HintsOfARun, AreLookedForAgainInTheNext) {
  mismatches(ReplayReports::kMostHints);
  reports->add({});
  mismatches(1);
  EXPECT_EQ(told(), ReplayReports::kMostHints + 1);
}

TEST_F(HintsOfARun, AreOfNoUseWhereTheTimeAloneIsWrong) {
  mismatches(1, MismatchKind::timing);
  EXPECT_EQ(told(), 0U);
  mismatches(1, MismatchKind::extra);
  EXPECT_EQ(told(), 1U);
}

class FilesOfReports : public ReplayReportsTest {
 protected:
  static std::string text_of(const std::string& path) {
    const Bytes bytes = test::read_file(path);
    return std::string(as_text(bytes));
  }
  // One run that passed, to its end: whether the files could be written.
  std::optional<bool> write() {
    begin(TapeTotals{});
    reports->add({});
    std::optional<bool> written;
    reports->finish(clock.now() + std::chrono::hours(1), [&written](bool all) { written = all; });
    run_until(loop, [&written] { return written.has_value(); });
    return written;
  }
  [[nodiscard]] bool told(const std::string& text) const {
    return book.text().find(text) != std::string::npos;
  }
};

TEST_F(FilesOfReports, EachIsWrittenWhereItIsWanted) {
  report_file = dir / "report.json";
  junit_file = dir / "report.xml";
  EXPECT_EQ(write(), true);
  EXPECT_THAT(text_of(report_file), HasSubstr("\"verdict\":\"pass\""));
  EXPECT_THAT(text_of(junit_file), HasSubstr("<testsuite"));
}

TEST_F(FilesOfReports, AreForNobodyWhoMayNotReadTheTape) {
  report_file = dir / "report.json";
  junit_file = dir / "report.xml";
  test::write_file(dir / "t.logr", ByteView{});
  ASSERT_EQ(::chmod((dir / "t.logr").c_str(), 0600), 0);
  EXPECT_EQ(write(), true);
  for (const std::string& file : {report_file, junit_file})
    EXPECT_EQ(std::filesystem::status(file).permissions(), std::filesystem::perms(0600)) << file;
}

TEST_F(FilesOfReports, EitherMayBeTheOnlyOne) {
  report_file = dir / "report.json";
  EXPECT_EQ(write(), true);
  EXPECT_TRUE(std::filesystem::exists(report_file));
  report_file.clear();
  junit_file = dir / "report.xml";
  EXPECT_EQ(write(), true);
  EXPECT_TRUE(std::filesystem::exists(junit_file));
}

TEST_F(FilesOfReports, EitherThatCannotBeWrittenIsAFailureAndTold) {
  report_file = dir / "report.json";
  junit_file = dir / "none/report.xml";
  EXPECT_EQ(write(), false);
  EXPECT_TRUE(told("none/report.xml"));
  EXPECT_TRUE(std::filesystem::exists(report_file)) << "the other one is written all the same";
}

TEST_F(FilesOfReports, TheOtherIsWrittenThoughTheFirstCannotBe) {
  report_file = dir / "none/report.json";
  junit_file = dir / "report.xml";
  EXPECT_EQ(write(), false);
  EXPECT_TRUE(told("none/report.json"));
  EXPECT_TRUE(std::filesystem::exists(junit_file));
}

TEST_F(FilesOfReports, OfTwoTroublesTheFirstIsTold) {
  report_file = dir / "none/report.json";
  junit_file = dir / "none/report.xml";
  EXPECT_EQ(write(), false);
  EXPECT_TRUE(told("none/report.json"));
  EXPECT_FALSE(told("none/report.xml"));
}

TEST_F(FilesOfReports, HaveTheRunsThatEndedWhileTheyWereWritten) {
  report_file = dir / "report.json";
  begin(TapeTotals{});
  for (int run = 0; run < 3; ++run) reports->add({});
  std::optional<bool> written;
  reports->finish(clock.now() + std::chrono::hours(1), [&written](bool all) { written = all; });
  run_until(loop, [&written] { return written.has_value(); });
  EXPECT_THAT(text_of(report_file), HasSubstr("\"count\":3"));
}

}  // namespace
}  // namespace porttape
