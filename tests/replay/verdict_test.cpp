// Strictness 1: what counts as a mismatch, and what is told about it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/hint.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

MemoryTape three_exchanges() {
  return MemoryTape()
      .write(1'000, "VV\n")
      .read(11'000, "VV\nvendor\n")
      .write(20'000, "BM\n")
      .read(30'000, "BM\nok\n")
      .write(40'000, "TM0\n")
      .read(50'000, "TM0\nok\n");
}

TEST(Data, DriverCutsDoNotMatter) {
  for (const std::size_t cut : {1U, 2U, 3U, 5U, 10U}) {
    Rig rig(three_exchanges(), failing());
    rig.open();
    const std::string all = "VV\nBM\nTM0\n";
    for (std::size_t i = 0; i < all.size(); i += cut) rig.write(std::string_view(all).substr(i, cut)).wait(7);
    rig.wait(1'000'000).close();
    EXPECT_EQ(rig.verdict(), Verdict::pass) << cut;
    EXPECT_EQ(rig.read(), "VV\nvendor\nBM\nok\nTM0\nok\n");
  }
}

TEST(Data, MismatchIsToldWithItsPlace) {
  Rig rig(three_exchanges(), failing());
  rig.open().write("VV\n").wait(100'000).write("BX\n");
  ASSERT_THAT(rig.mismatches, SizeIs(1));
  const Mismatch& mismatch = rig.mismatches[0];
  EXPECT_EQ(mismatch.kind, MismatchKind::data);
  EXPECT_EQ(mismatch.offset, 4U);
  EXPECT_EQ(to_us(mismatch.tape), 20'000);
  EXPECT_EQ(mismatch.real, Micros{100'000});
  EXPECT_EQ(as_text(mismatch.expected), "M\nTM0\n");
  EXPECT_EQ(as_text(mismatch.got), "X\n");
  EXPECT_EQ(as_text(mismatch.before), "VV\nB");
  EXPECT_EQ(mismatch.exchange, 2U);
  EXPECT_EQ(mismatch.hint, "");
}

TEST(Data, FailHangsUpEndsTheRunAndDeliversNoMore) {
  Rig rig(three_exchanges(), failing());
  rig.open().write("VX\n");
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->from_driver_bytes, 3U);
  EXPECT_EQ(rig.report->from_driver_matched, 1U);
  EXPECT_EQ(rig.report->from_driver_of, 10U);
  EXPECT_EQ(rig.report->to_driver_of, 23U);
  rig.write("VV\n").wait(10'000'000).close();
  EXPECT_THAT(rig.deliveries, IsEmpty());
  EXPECT_EQ(rig.runs, 1);
  (void)rig.finish();
  EXPECT_EQ(rig.runs, 1);
}

TEST(Data, AfterAFailedRunTheNextOpenBeginsAnother) {
  Rig rig(three_exchanges(), failing());
  rig.open().write("VX\n").close().wait(1'000'000).open().write("VV\n").wait(10'000);
  EXPECT_EQ(rig.read(), "VV\nvendor\n");
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
  EXPECT_EQ(rig.runs, 2);
}

TEST(Data, MissingLastRequestIsIncomplete) {
  Rig rig(three_exchanges(), failing());
  rig.open().write("VV\n").wait(50'000).write("BM\n").wait(50'000).write("T").close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_EQ(exit_status_of(*rig.report), 5);
  EXPECT_EQ(rig.report->next_expected_offset, 7U);
  EXPECT_EQ(as_text(rig.report->next_expected), "M0\n");
  EXPECT_EQ(to_us(rig.report->next_expected_tape), 40'000);
}

TEST(Data, BytesPastTheTapesWritesAreExtra) {
  Rig rig(three_exchanges(), failing());
  rig.open().write("VV\nBM\nTM0\nQT\n");
  EXPECT_EQ(rig.verdict(), Verdict::extra);
  EXPECT_EQ(exit_status_of(*rig.report), 3);
  ASSERT_TRUE(rig.report->mismatch);
  EXPECT_EQ(rig.report->mismatch->kind, MismatchKind::extra);
  EXPECT_EQ(rig.report->mismatch->offset, 10U);
  EXPECT_THAT(rig.report->mismatch->expected, IsEmpty());
  EXPECT_EQ(as_text(rig.report->mismatch->got), "QT\n");
  EXPECT_EQ(to_us(rig.report->mismatch->tape), 40'000);
}

TEST(Data, ExtraIsExtraAlsoAfterTheTapeIsUsedUp) {
  Rig rig(MemoryTape().read(0, "x"), failing());
  rig.open().wait(1'000'000).write("y");
  EXPECT_EQ(rig.verdict(), Verdict::extra);
  EXPECT_EQ(rig.report->mismatch->offset, 0U);
}

TEST(Data, LongMismatchesAreShownInPart) {
  Rig rig(MemoryTape().write(0, std::string(40, 'k') + std::string(100, 'a')), failing());
  rig.open().write(std::string(40, 'k') + std::string(100, 'b'));
  EXPECT_EQ(as_text(rig.mismatches.at(0).before), std::string(32, 'k'));
  EXPECT_EQ(as_text(rig.mismatches.at(0).expected), std::string(32, 'a'));
  EXPECT_EQ(as_text(rig.mismatches.at(0).got), std::string(32, 'b'));
}

TEST(Data, HintSaysWhenTheBytesAreStaleOrAhead) {
  const auto hint = [](std::string_view after_first) {
    Rig rig(three_exchanges(), failing());
    rig.open().write("VV\n").wait(50'000).write(after_first);
    const Mismatch& mismatch = rig.mismatches.at(0);
    return find_hint(rig.writes, mismatch.tape_offset, mismatch.got);
  };
  EXPECT_EQ(hint("VV\n"), "already consumed at offset 0 (tape 0.001000 s)");
  EXPECT_EQ(hint("TM0\n"), "comes later at offset 6 (tape 0.040000 s)");
  EXPECT_EQ(hint("ZZ\n"), "");
  EXPECT_EQ(hint("\n"),
            "already consumed at offset 2 (tape 0.001000 s); comes later at offset 5 (tape 0.020000 s)");
}

TEST(Data, AMegabyteInSingleBytesIsFine) {
  const std::string all(1'000'000, 'z');
  Rig rig(MemoryTape().write(0, all).read(10, "done"), failing());
  rig.open();
  for (const char& byte : all) rig.engine.on_write(rig.now(), as_bytes({&byte, 1}));
  rig.wait(10);
  EXPECT_EQ(rig.read(), "done");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Trouble, DamageEndsTheRun) {
  for (std::size_t call = 0; call < 7; ++call) {
    for (const bool in_writes : {false, true}) {
      Rig rig(three_exchanges(), failing());
      (in_writes ? rig.writes : rig.schedule).fail_at(call);
      rig.open().write("VV\n").wait(50'000).write("BM\n").wait(50'000).write("TM0\n").wait(50'000).close();
      ASSERT_TRUE(rig.report);
      if (rig.report->trouble) {
        EXPECT_EQ(*rig.report->trouble, "damaged at block 7");
        EXPECT_EQ(exit_status_of(*rig.report), 1);
      } else {
        EXPECT_TRUE(in_writes && call >= 3) << call;  // never read that far
      }
    }
  }
}

TEST(Finish, GivesTheReportOfABegunRunOnly) {
  Rig never(three_exchanges());
  never.engine.finish(never.now());
  never.settle();
  EXPECT_TRUE(never.engine.finished());
  EXPECT_EQ(never.runs, 0);
  Rig rig(three_exchanges());
  rig.open();
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
  EXPECT_EQ(rig.runs, 1);
}

TEST(Warn, LaterWritesAreFoundAgainOnALongTape) {
  MemoryTape tape;
  for (int i = 0; i < 30; ++i)
    tape.write(i * 1'000, "request " + std::to_string(i) + "\n").read(i * 1'000 + 500, "ok");
  Rig rig(std::move(tape));
  rig.open();
  for (int i = 0; i < 30; ++i)
    rig.write("request " + std::to_string(i % 7 == 3 ? 99 : i) + "\n").wait(100'000);
  EXPECT_EQ(rig.read().size(), 60U);
  EXPECT_THAT(rig.mismatches, SizeIs(4));
  EXPECT_EQ(rig.mismatches[3].exchange, 25U);
  EXPECT_EQ(as_text(rig.mismatches[3].expected).substr(0, 13), "24\nrequest 25");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
}

TEST(Warn, GoesOnAndComparesLaterExchangesAfresh) {
  Rig rig(three_exchanges());
  rig.open().write("XX\n").wait(20'000);
  EXPECT_EQ(rig.read(), "VV\nvendor\n");
  rig.write("BM\n").wait(20'000);
  EXPECT_EQ(rig.read(), "BM\nok\n");
  EXPECT_THAT(rig.mismatches, SizeIs(1));
  rig.write("TM1\n").wait(20'000);
  EXPECT_EQ(rig.read(), "TM0\nok\n");
  EXPECT_FALSE(rig.hung_up);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  ASSERT_THAT(rig.mismatches, SizeIs(2));
  EXPECT_EQ(rig.report->mismatches, 2U);
  EXPECT_EQ(rig.report->mismatch->offset, 0U);
  EXPECT_EQ(rig.mismatches[1].offset, 8U);
  EXPECT_EQ(rig.mismatches[1].exchange, 3U);
  EXPECT_EQ(rig.report->from_driver_matched, 5U);
}

}  // namespace
}  // namespace porttape::test
