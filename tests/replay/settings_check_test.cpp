// Which recorded settings a driver has to make, and which of them it made.

#include "libport/replay/settings_check.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "libport/tape/event.hpp"

namespace porttape {
namespace {

using Reach = SettingsCheck::Reach;

SeenSettings baud(unsigned rate) { return {.baud = rate, .stop_bits = 1}; }

class SettingsCheckTest : public testing::Test {
 public:
  SettingsCheckTest() { check.begin(SeenSettings::of({})); }

  SettingsCheckTest& pass(RecordKind kind, std::string_view data = {}) {
    Record record;
    record.kind = kind;
    record.at = tape_time_us(us);
    record.data = as_bytes(data);
    check.pass(record, writes);
    if (kind == RecordKind::write) writes += data.size();
    return *this;
  }
  SettingsCheckTest& taped(const SeenSettings& what, Side by = Side::driver) {
    const Event event = event::Settings{by, what, SettingsOrder::sampled};
    Record record;
    record.at = tape_time_us(us);
    record.event = &event;
    check.pass(record, writes);
    return *this;
  }
  SettingsCheckTest& wait(std::int64_t more_us = 1'000'000) {
    us += more_us;
    return *this;
  }
  // A second apart.
  void tape(const std::vector<unsigned>& rates) {
    for (const unsigned rate : rates) wait().taped(baud(rate));
  }
  void make(const std::vector<unsigned>& rates) {
    for (const unsigned rate : rates) check.made(line::Settings{baud(rate)});
  }
  // "made/recorded" and the rates that are missing.
  [[nodiscard]] std::string result(Reach reach = Reach::all, std::uint64_t up_to = 0) const {
    const SettingsReport report = check.report(reach, up_to);
    std::string text = std::to_string(report.made) + '/' + std::to_string(report.recorded);
    for (const auto& missing : report.missing)
      text += ' ' + std::to_string(missing.what.settings.baud.value_or(0));
    return text;
  }

  SettingsCheck check;
  std::int64_t us = 0;
  std::uint64_t writes = 0;
};

TEST_F(SettingsCheckTest, WhatIsMadeInOrderIsMadeWhateverIsMadeBetween) {
  tape({1, 2, 3});
  make({9, 1, 9, 2, 1, 3, 7});
  EXPECT_EQ(result(), "3/3");
}

TEST_F(SettingsCheckTest, WhatIsNeverMadeIsMissingWithItsPlace) {
  tape({1, 2, 3});
  make({1, 3});
  EXPECT_EQ(result(), "2/3 2");
  EXPECT_EQ(check.report(Reach::all, 0).missing.at(0),
            (SettingsReport::Missing{tape_time_us(2'000'000), LineView::of(baud(2))}));
}

TEST_F(SettingsCheckTest, AHuntWithOneMoreStepIsNoLeapOverTheRest) {
  tape({1, 2, 3, 1, 4});
  make({1, 3, 2, 3, 1, 4});
  EXPECT_EQ(result(), "5/5");
}

TEST_F(SettingsCheckTest, TheOrderCounts) {
  tape({1, 2});
  make({2, 1});
  EXPECT_EQ(result(), "1/2 2") << "either of them is missing";
}

TEST_F(SettingsCheckTest, OfEqualsTheEarlierOnesAreTheMadeOnes) {
  tape({600, 300, 600});
  make({300, 600, 300, 900});
  EXPECT_EQ(result(), "2/3 600");
  EXPECT_EQ(check.report(Reach::all, 0).missing.at(0).at, tape_time_us(3'000'000));
}

TEST_F(SettingsCheckTest, EitherSideMayBeAhead) {
  make({1, 2});
  tape({1, 2, 3});
  make({3});
  EXPECT_EQ(result(), "3/3");
}

TEST_F(SettingsCheckTest, WhatIsReplacedBeforeItIsSureToBeSeenNeedNotBeMade) {
  taped(baud(1)).wait(49'999).taped(baud(2)).wait(50'000).taped(baud(3)).wait();
  EXPECT_EQ(result(), "0/2 2 3");
  make({1, 2, 3});
  EXPECT_EQ(result(), "2/2");
}

TEST_F(SettingsCheckTest, WhatWasAnsweredWasSeen) {
  taped(baud(1))
      .pass(RecordKind::write, "ask")
      .pass(RecordKind::read, "answer")
      .wait(10)
      .taped(baud(2))
      .wait();
  EXPECT_EQ(result(), "0/2 1 2");
}

TEST_F(SettingsCheckTest, BytesThatAnswerNothingDoNotShowThatItWasSeen) {
  taped(baud(1))
      .pass(RecordKind::read, "noise")
      .pass(RecordKind::write, "ask")
      .wait(10)
      .taped(baud(2))
      .wait();
  EXPECT_EQ(result(), "0/1 2");
}

TEST_F(SettingsCheckTest, WhatADriverRestoresJustBeforeItsCloseNeedNotBeMade) {
  taped(baud(1)).wait().taped(baud(9600)).wait(20).pass(RecordKind::close);
  make({1});
  EXPECT_EQ(result(), "1/1");
}

TEST_F(SettingsCheckTest, OnlyWhatTheReplayingLineShowsCounts) {
  taped(SeenSettings::of({.parity = Parity::even})).wait();  // as before, to one who sees no parity
  taped(SeenSettings::of({.baud = 300, .parity = Parity::odd})).wait();
  EXPECT_EQ(result(), "0/1 300");
  check.made(line::Settings{{.baud = 300}});
  EXPECT_EQ(result(), "1/1");
  check.made(line::Settings{SeenSettings::of({.baud = 300})});  // this one does see it
  EXPECT_EQ(result(), "1/2 9600");
}

TEST_F(SettingsCheckTest, WhatChangesNothingNeedNotBeMade) {
  tape({9600, 9600, 300, 300});
  make({300});
  EXPECT_EQ(result(), "1/1");
}

TEST_F(SettingsCheckTest, TheDevicesOwnChangeTheLineToo) {
  tape({300});
  wait().taped(baud(1200), Side::device);
  tape({300});
  make({300});
  EXPECT_EQ(result(), "1/2 300");
}

TEST_F(SettingsCheckTest, WhatTheDriverDidNotComeToDoesNotCount) {
  tape({1});
  pass(RecordKind::write, "ask");
  tape({2});
  EXPECT_EQ(result(Reach::written, 0), "0/0");
  EXPECT_EQ(result(Reach::written, 1), "0/1 1");
  EXPECT_EQ(result(Reach::written, 3), "0/1 1");
  EXPECT_EQ(result(Reach::written, 4), "0/2 1 2");
  make({2});
  EXPECT_EQ(result(Reach::written, 0), "0/0");
  EXPECT_EQ(result(Reach::written, 1), "0/1 1") << "what is behind it stands for nothing";
}

TEST_F(SettingsCheckTest, WhatWasDeliveredBehindItShowsHowFarOneCameThatIsKeptFromGoingOn) {
  tape({1});
  check.delivered();
  tape({2});
  EXPECT_EQ(result(Reach::delivered, 0), "0/1 1");
  EXPECT_EQ(result(Reach::written, 0), "0/0");
}

TEST_F(SettingsCheckTest, ARunBeginsAnew) {
  tape({1});
  make({1});
  check.begin(baud(2));
  tape({2, 3});
  EXPECT_EQ(result(), "0/1 3");
}

TEST_F(SettingsCheckTest, FloodsOnBothSidesAreComparedInPieces) {
  for (unsigned i = 1; i <= 10'000; ++i) {
    tape({i % 7 + 1});
    make({i % 7 + 1});
  }
  EXPECT_EQ(result(), "10000/10000");
}

TEST_F(SettingsCheckTest, AFloodOnOneSideLosesNothingOfTheOther) {
  tape({1, 2});
  for (unsigned i = 100; i <= 10'000; ++i) make({i});
  make({1, 2});
  EXPECT_EQ(result(), "2/2");
  check.begin({});
  make({1, 2});
  for (unsigned i = 100; i <= 10'000; ++i) tape({i});
  const SettingsReport report = check.report(Reach::all, 0);
  EXPECT_EQ(report.recorded, 9'901U);
  EXPECT_EQ(report.made, 0U);
  EXPECT_EQ(report.missing.size(), SettingsReport::kMostMissing);
}

TEST_F(SettingsCheckTest, FiftyMillisecondsAreEnoughToBeSeen) {
  wait().taped(baud(1)).wait(50'000).taped(baud(2));
  make({2});
  EXPECT_EQ(result(), "1/2 1");
}

TEST_F(SettingsCheckTest, LessThanFiftyMillisecondsAreNot) {
  wait().taped(baud(1)).wait(49'999).taped(baud(2));
  make({2});
  EXPECT_EQ(result(), "1/1");
}

TEST_F(SettingsCheckTest, SixtyFourThatAreMissingAreListedAndAllAreCounted) {
  std::vector<unsigned> rates;
  for (unsigned rate = 1; rate <= 65; ++rate) rates.push_back(rate);
  tape(rates);
  const SettingsReport report = check.report(Reach::all, 0);
  EXPECT_EQ(report.recorded, 65U);
  EXPECT_EQ(report.made, 0U);
  ASSERT_EQ(report.missing.size(), 64U);
  EXPECT_EQ(report.missing.back().what, LineView::of(baud(64)));
}

TEST_F(SettingsCheckTest, AWriteThatStandsWhereTheSettingDoesIsBehindIt) {
  tape({1});
  pass(RecordKind::write, "abc");
  tape({2});
  EXPECT_EQ(result(Reach::written, 0), "0/0");
  EXPECT_EQ(result(Reach::written, 1), "0/1 1");
  EXPECT_EQ(result(Reach::written, 3), "0/1 1") << "the second is behind all three";
  EXPECT_EQ(result(Reach::written, 4), "0/2 1 2");
}

TEST_F(SettingsCheckTest, EachKeyCountsWhereTheReplayingLineShowsIt) {
  const std::vector<SeenSettings> each = {{.baud = 300},    {.data_bits = 7},  {.parity = Parity::even},
                                          {.stop_bits = 2}, {.hw_flow = true}, {.sw_flow = true}};
  for (std::size_t taped_key = 0; taped_key < each.size(); ++taped_key) {
    for (std::size_t shown = 0; shown < each.size(); ++shown) {
      check.begin(SeenSettings::of({}));
      wait().taped(each[taped_key]).wait();
      check.made(line::Settings{each[shown]});
      EXPECT_EQ(result(), taped_key == shown ? "1/1" : "0/0") << taped_key << ' ' << shown;
    }
  }
}

TEST_F(SettingsCheckTest, AKeyThatWasShownOnceCounts) {
  const std::vector<SeenSettings> each = {{.baud = 300},    {.data_bits = 7},  {.parity = Parity::even},
                                          {.stop_bits = 2}, {.hw_flow = true}, {.sw_flow = true}};
  for (std::size_t key = 0; key < each.size(); ++key) {
    check.begin(SeenSettings::of({}));
    wait().taped(each[key]).wait();
    check.made(line::Settings{each[key]});
    check.made(line::Settings{each[(key + 1) % each.size()]});
    EXPECT_EQ(result(), "1/1") << key;
  }
}

TEST_F(SettingsCheckTest, AnOpenSetsTheSignalsAnew) {
  check.begin(SeenSettings::of({}), true);
  const Event off = signal_event({Side::driver, {LineSignal::Name::rts, false}});
  for (int session = 0; session < 2; ++session) {
    wait().pass(RecordKind::open).wait();
    Record record;
    record.at = tape_time_us(us);
    record.event = &off;
    check.pass(record, writes);
    wait().pass(RecordKind::close);
  }
  EXPECT_EQ(check.report(Reach::all, 0).recorded, 2U);
}

}  // namespace
}  // namespace porttape
