#include <map>
#include <string>

#include <gtest/gtest.h>

#include "libport/infer/frame_sort.hpp"
#include "tests/infer/sessions.hpp"

namespace porttape {
namespace {

using test::session;

std::string names(const FoundSorts& found) {
  std::string all;
  for (const FrameSort& sort : found.sorts) all += (all.empty() ? "" : " ") + sort.format.name.raw();
  return all;
}

TEST(Formats, ThoseOfKnownProtocolsAreFoundWhateverTheSeed) {
  const std::map<std::string_view, std::string> expected{
      {"modbus_rtu", "frame"}, {"modbus_tcp", "frame"}, {"nmea", "nmea"},        {"ubx", "ubx"},
      {"scip", "line"},        {"mavlink1", "mavlink"}, {"mavlink2", "mavlink"}, {"gdb", "gdb ack"}};
  for (const test::SessionKind& kind : test::session_kinds()) {
    for (std::uint32_t seed = 1; seed < 12; seed += 2) {
      const std::vector<SessionTape> sessions{session(kind.make({.seed = seed})),
                                              session(kind.make({.seed = seed + 1}))};
      const FoundSorts found = find_sorts(sessions);
      EXPECT_EQ(names(found), expected.at(kind.name)) << found.why;
      for (const SessionTape& session : sessions) {
        std::size_t framed = 0;
        for (const Frame& frame : cut_frames(session, found.sorts)) framed += frame.bytes.size();
        EXPECT_EQ(framed, session.writes.size());
      }
    }
  }
}

TEST(Formats, ALengthFieldIsFoundWhereNoProtocolIsKnown) {
  const FrameFormat modbus =
      find_sorts(std::vector{session(test::modbus_tcp_session({.seed = 1}))}).sorts.front().format;
  EXPECT_EQ(modbus.kind, FrameFormat::Kind::length);
  EXPECT_EQ(modbus.length, (LengthField{4, 2, ByteOrder::big, 6, {}}));
  test::MemoryTape tape;
  for (int i = 0; i < 9; ++i)
    tape.write(i, "\x02" + std::string(1, static_cast<char>(i % 4 + 1)) +
                      std::string(std::size_t(i % 4) + 1, 'x') + "!");
  const FrameFormat format = find_sorts(std::vector{session(tape)}).sorts.front().format;
  EXPECT_EQ(format.kind, FrameFormat::Kind::length);
  EXPECT_EQ(format.start, Bytes{2});
  EXPECT_EQ(format.length, (LengthField{1, 1, ByteOrder::big, 3, {}}));
}

TEST(Formats, ABlockOfSeveralLinesIsSeveralFrames) {
  test::MemoryTape tape;
  tape.write(1, "GET A\nGET B\n").write(2, "GET").write(3, " C\n");
  const SessionTape session = test::session(tape);
  FrameSort line;
  line.format.end = {'\n'};
  EXPECT_EQ(cut_frames(session, std::span(&line, 1)).size(), 3U);
}

TEST(Formats, BytesOfNoFrameAreLeftOut) {
  test::MemoryTape tape;
  tape.write(1, "xx$a#61y").write(2, "$b#62");
  const SessionTape session = test::session(tape);
  FrameSort packet;
  packet.format.start = {'$'};
  packet.format.end = {'#'};
  packet.format.trailer = 2;
  const auto frames = cut_frames(session, std::span(&packet, 1));
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[0].begin, 2U);
  EXPECT_EQ(frames[1].begin, 8U);
}

}  // namespace
}  // namespace porttape
