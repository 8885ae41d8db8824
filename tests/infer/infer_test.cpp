// Rules inferred from two sessions of each protocol: the checksum and the counters are the protocol's,
// nothing may vary but what the driver varies, and the proof holds; whatever the seeds, and with polls as
// often as they like.

#include "libport/infer/infer.hpp"

#include <fmt/format.h>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/framing.hpp"
#include "libport/rules/rules_reader.hpp"
#include "tests/infer/sessions.hpp"

namespace porttape {
namespace {

using test::session;
using test::SessionShape;

// "XOR from 1 to -5 at -4 hex", or "none", of each format that has frames of its own.
std::string checksum_of(const FrameFormat& format) {
  if (!format.checksum) return "none";
  const ChecksumField& field = *format.checksum;
  return fmt::format("{} from {} to {} at {}{}{}{}", field.kind, field.from, field.to.value_or(field.at),
                     field.at, field.order == ByteOrder::little ? " little" : "", field.hex ? " hex" : "",
                     field.mavlink_extra ? " extra" : "");
}

// "at 2 size 1", "column 2": the counters.
std::vector<std::string> counters_of(const RuleSet& rules) {
  std::vector<std::string> all;
  for (const Rule& rule : rules.rules) {
    if (rule.kind != Rule::Kind::counter) continue;
    all.push_back(rule.place.by == Place::By::column
                      ? fmt::format("column {}", rule.place.column)
                      : fmt::format("at {} size {}", rule.place.at, *rule.place.size));
  }
  return all;
}

FrameSpan behind(ByteView frame, std::string_view text, std::string_view up_to) {
  const std::size_t begin = as_text(frame).find(text);
  if (begin == std::string_view::npos) return {};
  const std::size_t from = begin + text.size();
  return {from, as_text(frame).find_first_of(up_to, from)};
}

std::vector<FrameSpan> modbus_rtu_varies(ByteView frame) {
  return {frame[1] == 6 ? FrameSpan{4, 6} : frame[1] == 16 ? FrameSpan{7, 11} : FrameSpan{}};
}
std::vector<FrameSpan> modbus_tcp_varies(ByteView frame) {
  return {FrameSpan{0, 2}, frame[7] == 6    ? FrameSpan{10, 12}
                           : frame[7] == 16 ? FrameSpan{13, 15}
                                            : FrameSpan{}};
}
std::vector<FrameSpan> nmea_varies(ByteView frame) {
  return {behind(frame, "$PMTK741,", "*"), behind(frame, "$PTIM,", ","), behind(frame, "$PABC,SEQ,", ",")};
}
std::vector<FrameSpan> ubx_varies(ByteView frame) {
  if (frame[2] == 0x13) return {FrameSpan{10, 30}};
  if (frame[3] == 0x8a) return {FrameSpan{10, frame.size() - 2}};
  return {frame[3] == 0x01 ? FrameSpan{7, 8} : FrameSpan{}};
}
std::vector<FrameSpan> scip_varies(ByteView frame) { return {behind(frame, ";run-", "\n")}; }
std::vector<FrameSpan> mavlink_varies(ByteView frame) {
  const bool second = frame[0] == 0xfd;
  const std::size_t payload = second ? 10 : 6;
  const Byte message = frame[second ? 7 : 5];
  const FrameSpan sequence = second ? FrameSpan{4, 5} : FrameSpan{2, 3};
  return {sequence, message == 2 || message == 76 ? FrameSpan{payload, payload + 12} : FrameSpan{}};
}
std::vector<FrameSpan> gdb_varies(ByteView frame) {
  return {behind(frame, "$Hgp", "#"), behind(frame, "$m", ","),         behind(frame, "$Z0,", ","),
          behind(frame, "$X", ","),   behind(frame, "$vCont;c:p", "."), behind(frame, "$D;", "#")};
}

// What is so of a protocol.
struct Truth {
  std::string_view name;
  std::string checksum;
  std::vector<std::string> counters;
  std::function<std::vector<FrameSpan>(ByteView)> varies;
};

const std::vector<Truth>& truths() {
  static const std::vector<Truth> all{
      {"modbus_rtu", "CRC-16/MODBUS from 0 to -2 at -2 little", {}, modbus_rtu_varies},
      {"modbus_tcp", "none", {"at 0 size 2"}, modbus_tcp_varies},
      {"nmea", "XOR from 1 to -5 at -4 hex", {"column 2"}, nmea_varies},
      {"ubx", "FLETCHER-UBX from 2 to -2 at -2", {}, ubx_varies},
      {"scip", "none", {}, scip_varies},
      {"mavlink1", "CRC-16/MCRF4XX from 1 to -2 at -2 little extra", {"at 2 size 1"}, mavlink_varies},
      {"mavlink2", "CRC-16/MCRF4XX from 1 to -2 at -2 little extra", {"at 4 size 1"}, mavlink_varies},
      {"gdb", "SUM-8 from 1 to -3 at -2 hex", {}, gdb_varies},
  };
  return all;
}

// Every part of every frame that may vary is one that the driver varies.
void expect_nothing_else_varies(const Truth& truth, const RuleSet& rules, const SessionTape& tape) {
  const RuleBook book(rules);
  for (const SessionTape::Block& block : tape.blocks) {
    if (block.direction != Direction::write) continue;
    const ByteView frame = tape.bytes_of(block);
    const FrameCut cut = cut_frame(rules.frames, frame, true);
    if (cut.state != FrameCut::State::frame) continue;
    for (const FrameField& field : book.layout(frame, cut.format).fields) {
      if (field.of != FrameField::Of::rule) continue;
      const auto spans = truth.varies(frame);
      const bool may = std::any_of(spans.begin(), spans.end(), [&](const FrameSpan& span) {
        return field.span.begin >= span.begin && field.span.end <= span.end;
      });
      EXPECT_TRUE(may) << rules.rules[static_cast<std::size_t>(field.rule)].name.raw() << " of "
                       << to_printable(frame);
    }
  }
}

struct Case {
  std::string_view name;
  bool free_polls;
};
class InferTest : public testing::TestWithParam<Case> {};

TEST_P(InferTest, ChecksumsAndCountersAreRightNothingElseVariesAndTheProofHolds) {
  const auto kind = std::ranges::find(test::session_kinds(), GetParam().name, &test::SessionKind::name);
  const auto truth = std::ranges::find(truths(), GetParam().name, &Truth::name);
  for (std::uint32_t seed = 1; seed < 12; seed += 2) {
    SCOPED_TRACE(fmt::format("seeds {} and {}", seed, seed + 1));
    std::vector<SessionTape> tapes;
    for (const std::uint32_t each : {seed, seed + 1})
      tapes.push_back(session(kind->make({.seed = each, .free_polls = GetParam().free_polls})));
    const Inference found = infer_rules(tapes, {.changes = 900});
    EXPECT_THAT(found.rules.frames, testing::Contains(testing::ResultOf(checksum_of, truth->checksum)));
    EXPECT_EQ(counters_of(found.rules), truth->counters);
    EXPECT_TRUE(found.alike);
    EXPECT_TRUE(found.proven()) << testing::PrintToString(proof_text(found.proof, tapes));
    EXPECT_GT(found.proof.tried, 150U);
    EXPECT_GT(found.proof.inside, 0U);
    for (const SessionTape& tape : tapes) expect_nothing_else_varies(*truth, found.rules, tape);
    const auto read = read_rules(to_toml(found.rules), "inferred");
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(*read, found.rules) << "as written to a file";
  }
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const test::SessionKind& kind : test::session_kinds())
    for (const bool free_polls : {false, true}) all.push_back({kind.name, free_polls});
  return all;
}
INSTANTIATE_TEST_SUITE_P(Protocols, InferTest, testing::ValuesIn(cases()), [](const auto& each) {
  return std::string(each.param.name) + (each.param.free_polls ? "_polls_free" : "");
});

// "modbus_tcp: frame counter at 0 echoed"
TEST(Infer, WhatAnswersRepeatOfTheRequestIsCopiedIntoThem) {
  const std::map<std::string_view, std::vector<std::string>> expected{
      {"modbus_tcp", {"frame counter at 0 echoed", "06 of 12 bytes bytes at 10 echoed"}},
      {"scip", {"MD field 1 echoed"}},
      {"nmea", {"$PABC field 3 echoed"}},
      {"mavlink2", {}},
      {"ubx", {}}};
  for (const auto& [name, replies] : expected) {
    const auto kind = std::ranges::find(test::session_kinds(), name, &test::SessionKind::name);
    const Inference found = infer_rules(
        std::vector{session(kind->make({.seed = 1})), session(kind->make({.seed = 2}))}, {.changes = 90});
    std::vector<std::string> names;
    for (const ReplyTemplate& reply : found.rules.replies) names.push_back(reply.name.raw());
    EXPECT_EQ(names, replies) << name;
  }
}

TEST(Infer, TapesThatAreAlikeNeedNoRule) {
  const SessionTape tape = session(test::scip_session({.seed = 1}));
  const Inference found = infer_rules(std::vector{tape, tape});
  EXPECT_TRUE(found.rules.rules.empty());
  EXPECT_TRUE(found.proof.holds());
  EXPECT_EQ(found.proof.inside, 0U);
}

TEST(Infer, MoreTapesFreeWhatVariesInAnyOfThem) {
  std::vector<SessionTape> tapes;
  for (std::uint32_t seed = 1; seed < 6; ++seed) tapes.push_back(session(test::nmea_session({.seed = seed})));
  const Inference found = infer_rules(tapes, {.changes = 300});
  EXPECT_TRUE(found.proof.holds());
  EXPECT_EQ(found.proof.pairs.size(), 25U);
}

TEST(Infer, SessionsOfDifferentDriversAreNotProven) {
  const std::vector tapes{session(test::scip_session({.seed = 1}), "scip"),
                          session(test::nmea_session({.seed = 1}), "nmea")};
  const Inference found = infer_rules(tapes, {.changes = 300});
  EXPECT_FALSE(found.alike);
  EXPECT_FALSE(found.proven());
}

TEST(Infer, WhatIsLeftOutIsTold) {
  test::MemoryTape tape = test::gdb_session({.seed = 1});
  tape.write(90'000'000, "~").gap(90'000'001, 5, 90'000'000);
  const Inference found = infer_rules(std::vector{session(tape, "one"), session(tape, "two")});
  EXPECT_THAT(found.unexplained, testing::Contains(testing::HasSubstr("2 bytes of no frame")));
  EXPECT_THAT(found.unexplained, testing::Contains(testing::HasSubstr("one has a gap")));
}

}  // namespace
}  // namespace porttape
