#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/capture_bytes.hpp"
#include "tests/formats/convert_tape.hpp"
#include "tests/support/random_tape.hpp"

namespace porttape {
namespace {

using test::CaptureBytes;
using test::exported;
using test::imported;
using test::lines_of;
using test::MemoryTape;
using test::rtac_packet;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr unsigned kRtac = 250;
constexpr unsigned kStatus = 0;
constexpr unsigned kSent = 1;
constexpr unsigned kReceived = 2;

ImportOptions of_device(const std::string& name) {
  ImportOptions options;
  options.device = name;
  return options;
}

class RtacFormatTest : public testing::Test {
 protected:
  TapePaths tape(const MemoryTape& records,
                 const TapeHeader& header = {.device = "serial:/dev/ttyUSB0", .driver = "pty:/tmp/laser"}) {
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++made_))), records, header);
  }
  Result<ImportedTape> read(const std::string& text, const ImportOptions& options = {}) {
    return imported(dir, "back" + std::to_string(++made_), "pcapng", text, options);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(RtacFormatTest, RandomTapesComeBackExactly) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    std::mt19937 random(seed);
    const auto choose = [&](std::uint32_t n) {
      return n == 0 ? 0U : static_cast<std::uint32_t>(random()) % n;
    };
    TapeHeader header{.device = "serial:/dev/ttyUSB0", .driver = "pty:/tmp/laser"};
    if (seed % 2 == 0) header.zero = TapeZero{"2024-05-06T07:08:08.999871Z", 5, "boot"};
    if (seed % 3 == 0) header.zero = TapeZero{"no time", 5, "boot"};
    const TapePaths paths = tape(
        test::random_tape(
            choose, {.sessions = true, .hang_ups = true, .half_closes = true, .gaps = true, .signals = true}),
        header);
    const std::string capture = exported(paths, "pcapng");
    const auto back = read(capture);
    ASSERT_TRUE(back) << "seed " << seed << ": " << back.error().message;
    EXPECT_EQ(test::lines_on(back->paths), test::lines_on(paths)) << "seed " << seed;
    EXPECT_EQ(test::header_line_of(back->paths), test::header_line_of(paths)) << "seed " << seed;
    EXPECT_THAT(back->problems, ElementsAre());
    EXPECT_EQ(detect_format(capture, ""), find_format("pcapng"));
  }
}

TEST_F(RtacFormatTest, LargeBlocksAndLinesComeBack) {
  std::string large;
  for (int i = 0; i < 1'000'000; ++i) large += static_cast<char>(i % 251);
  event::Unknown strange{"strange"};
  const TapePaths paths = literal_tape(dir / "large");
  auto made = NewTape::create(paths, TapeHeader{}, {.sync = false});
  ASSERT_TRUE(made);
  ASSERT_TRUE(made->block(Direction::write, tape_time_us(5), as_bytes(large)));
  ASSERT_TRUE(made->block(Direction::read, tape_time_us(5), {}));
  const std::string line = R"({"t_us":6,"event":"strange","text":")" + std::string(65'480, 'x') + "\"}";
  ASSERT_TRUE(made->event_line(tape_time_us(6), line));
  ASSERT_TRUE(made->block(Direction::read, tape_time_us(7), as_bytes(large)));
  ASSERT_TRUE(made->finish(tape_time_us(8)));
  EXPECT_EQ(lines_of(read(exported(paths, "pcapng"))), test::lines_on(paths));
}

TEST_F(RtacFormatTest, ATapeWithoutEndHasNone) {
  const TapePaths paths = literal_tape(dir / "killed");
  auto made = NewTape::create(paths, TapeHeader{}, {.sync = false});
  ASSERT_TRUE(made && made->event(tape_time_us(0), event::Open{}) && made->finish(std::nullopt));
  const auto back = read(exported(paths, "pcapng"));
  ASSERT_TRUE(back);
  auto reader = TapeReader::open(back->paths);
  ASSERT_TRUE(reader && reader->next());
  EXPECT_FALSE(*reader->next());
}

TEST_F(RtacFormatTest, PcapHoldsBytesTimesAndLines) {
  const TapePaths paths = tape(MemoryTape()
                                   .open(0)
                                   .write(10, "AT\r")
                                   .event(15, signal_event({Side::device, {LineSignal::Name::cts, true}}))
                                   .event(16, signal_event({Side::driver, {LineSignal::Name::rts, false}}))
                                   .read(20, "OK\r")
                                   .event(30, signal_event({Side::device, {LineSignal::Name::brk, true}})));
  const std::string capture = exported(paths, "rtac");
  EXPECT_EQ(detect_format(capture, ""), find_format("rtac"));
  const auto back = read(capture);
  EXPECT_THAT(lines_of(back), testing::IsSupersetOf({
                                  R"({"t_us":0,"event":"open"})",
                                  R"({"t_us":15,"event":"modem","line":"cts","state":"on","by":"device"})",
                                  R"({"t_us":16,"event":"modem","line":"rts","state":"off","by":"driver"})",
                                  R"({"t_us":30,"event":"break","state":"on","by":"device"})",
                              }));
  EXPECT_EQ(back->blocks, 2U);
}

TEST_F(RtacFormatTest, PcapHoldsWhenBreaksEnd) {
  const auto brk = [](bool on) { return signal_event({Side::driver, {LineSignal::Name::brk, on}}); };
  std::vector<std::string> losses;
  const auto read_back = [&](const MemoryTape& records) {
    std::vector<std::string> lines = lines_of(read(exported(tape(records), "rtac", &losses)));
    std::erase_if(lines, [](const std::string& line) { return line.find("modem") != std::string::npos; });
    return lines;
  };
  EXPECT_THAT(
      read_back(MemoryTape().open(0).write(10, "a").event(30, brk(true)).event(45, brk(false))),
      ElementsAre(HasSubstr("open"), "w 10 a", R"({"t_us":30,"event":"break","state":"on","by":"device"})",
                  R"({"t_us":45,"event":"break","state":"off","by":"device"})"));
  EXPECT_THAT(losses, Contains(HasSubstr("driver's")));
  EXPECT_THAT(losses, testing::Not(Contains(HasSubstr("when a break ends"))));
  EXPECT_THAT(read_back(MemoryTape().open(0).event(30, brk(true)).read(40, "a").event(45, brk(false))),
              ElementsAre(HasSubstr("open"), HasSubstr(R"("t_us":30,"event":"break","state":"on")"),
                          HasSubstr(R"("t_us":30,"event":"break","state":"off")"), "r 40 a"));
  EXPECT_THAT(losses, Contains(HasSubstr("when a break ends")));
}

class ForeignCapture : public RtacFormatTest, public testing::WithParamInterface<Endian> {};

TEST_P(ForeignCapture, BothOrdersInterfacesUnknownBlocksAndNanoseconds) {
  constexpr std::uint64_t kStart = 1'700'000'000'000'000'000;
  const std::string capture = CaptureBytes(GetParam())
                                  .section()
                                  .block(0x0bad, "what nobody knows")
                                  .interface(1, "eth0")
                                  .interface(kRtac, "COM1", 9)
                                  .interface(kRtac, "COM2", 9)
                                  .packet(0, 5, "a frame of the network")
                                  .packet(1, kStart, rtac_packet(kSent, 0, "AT\r"))
                                  .packet(2, kStart + 1'000, rtac_packet(kSent, 0, "other"))
                                  .packet(1, kStart + 2'000'999, rtac_packet(kReceived, 0, "OK"))
                                  .packet(1, kStart + 3'000'000, rtac_packet(4, 0, "\r"))
                                  .str();
  EXPECT_EQ(read(capture)->blocks, 3U);
  const auto first = read(capture);
  EXPECT_THAT(lines_of(first),
              ElementsAre(R"({"t_us":0,"event":"open"})", "w 0 AT\\r", "r 2000 OK",
                          HasSubstr("of several interfaces 'COM1' is taken, not 'COM2'"), "r 3000 \\r"));
  EXPECT_THAT(test::header_line_of(first->paths), HasSubstr("\"wall\":\"2023-11-14T22:13:20.000000Z\""));
  const auto second = read(capture, of_device("COM2"));
  EXPECT_THAT(lines_of(second), Contains(HasSubstr("other")));
  EXPECT_EQ(second->blocks, 1U);
  EXPECT_THAT(read(capture, of_device("COM3")).error().message, HasSubstr("has no interface 'COM3'"));
}

TEST_P(ForeignCapture, EqualTimesKeepTheOrder) {
  CaptureBytes capture = CaptureBytes(GetParam()).section().interface(kRtac);
  for (const char* const bytes : {"A1", "a1", "B2", "b2"})
    capture.packet(0, 7, rtac_packet(bytes[0] < 'a' ? kSent : kReceived, 0, bytes));
  EXPECT_THAT(lines_of(read(capture.str())),
              ElementsAre(R"({"t_us":0,"event":"open"})", "w 0 A1", "r 0 a1", "w 1 B2", "r 1 b2"));
}

TEST_P(ForeignCapture, SimplePacketsHaveNoTime) {
  const std::string bytes = rtac_packet(kSent, 0, "hello");
  CaptureBytes body(GetParam());
  const std::string capture = CaptureBytes(GetParam())
                                  .section()
                                  .interface(kRtac)
                                  .block(3, body.u32(bytes.size()).text(bytes).str())
                                  .str();
  const auto made = read(capture);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->blocks, 1U);
  EXPECT_THAT(made->guesses, ElementsAre(HasSubstr("without a time")));
}

TEST_P(ForeignCapture, PcapOfBothResolutions) {
  const std::string sent = rtac_packet(kSent, 0x18, "AT\r");
  const auto micro = CaptureBytes(GetParam()).pcap(kRtac).record(100, 5, sent).record(101, 6, sent).str();
  const auto nano = CaptureBytes(GetParam())
                        .pcap(kRtac, 0xa1b23c4d)
                        .record(100, 5'000, sent)
                        .record(101, 6'999, sent)
                        .str();
  EXPECT_THAT(lines_of(read(micro)), Contains(HasSubstr("1000001")));
  EXPECT_EQ(lines_of(read(micro)), lines_of(read(nano)));
}

INSTANTIATE_TEST_SUITE_P(Each, ForeignCapture, testing::Values(Endian::little, Endian::big),
                         [](const auto& each) { return each.param == Endian::big ? "big" : "little"; });

TEST_F(RtacFormatTest, ForeignPacketsTellLinesAndErrors) {
  const auto packet = [](unsigned what, unsigned lines, std::string_view bytes = "") {
    return rtac_packet(what, lines, bytes);
  };
  const std::string capture = CaptureBytes()
                                  .section()
                                  .interface(kRtac)
                                  .packet(0, 10, packet(kStatus, 0x19))
                                  .packet(0, 20, packet(kStatus, 0x18))
                                  .packet(0, 30, packet(9, 0x18))
                                  .packet(0, 40, packet(7, 0x18, "x"))
                                  .packet(0, 50, packet(5, 0x18))
                                  .packet(0, 60, packet(6, 0x18))
                                  .str();
  EXPECT_THAT(
      lines_of(read(capture)),
      ElementsAre(HasSubstr("open"), HasSubstr(R"("line":"cd","state":"off")"),
                  HasSubstr(R"("line":"dsr","state":"off")"), HasSubstr(R"("line":"ri","state":"off")"),
                  HasSubstr(R"("line":"cts","state":"on")"),
                  HasSubstr(R"({"t_us":10,"event":"modem","line":"cts","state":"off")"),
                  HasSubstr(R"("break","state":"on")"), HasSubstr(R"("break","state":"off")"),
                  HasSubstr("framing error"), testing::AllOf(HasSubstr("x"), HasSubstr("30")),
                  HasSubstr("the capture lost data")));
}

TEST_F(RtacFormatTest, ATornEndIsToldWithItsByte) {
  const std::string capture = CaptureBytes()
                                  .section()
                                  .interface(kRtac)
                                  .packet(0, 10, rtac_packet(kSent, 0, "one"))
                                  .packet(0, 20, rtac_packet(kSent, 0, "two"))
                                  .str();
  const std::size_t last = capture.size() - 48;
  for (std::size_t size = last + 1; size < capture.size(); ++size) {
    const auto made = read(capture.substr(0, size));
    ASSERT_TRUE(made) << made.error().message;
    EXPECT_EQ(made->blocks, 1U);
    ASSERT_EQ(made->problems.size(), 1U);
    EXPECT_THAT(made->problems.front(), HasSubstr("begins at byte " + std::to_string(last)));
  }
}

TEST_F(RtacFormatTest, DamageIsToldWithItsByte) {
  const auto error = [&](const std::string& capture) {
    const auto made = read(capture);
    return made ? "" : made.error().message;
  };
  const std::string head = CaptureBytes().section().interface(kRtac).str();
  const std::string at = "evidence at byte " + std::to_string(head.size()) + ": ";
  EXPECT_THAT(error(head + CaptureBytes().u32(6).u32(9).u32(0).str()), HasSubstr(at));
  EXPECT_THAT(error(head + CaptureBytes().u32(6).u32(0xfffffff0).u32(0).str()), HasSubstr(at));
  EXPECT_THAT(error(head + CaptureBytes().u32(6).u32(16).u32(0).u32(12).str()), HasSubstr(at));
  EXPECT_THAT(error(CaptureBytes().pcap(kRtac).u32(0).u32(0).u32(0x7fffffff).u32(0).str()),
              HasSubstr("evidence at byte 24: "));
  EXPECT_THAT(error("\n\r\r\nabcdefgh"), HasSubstr("evidence at byte 0: "));
  EXPECT_THAT(error("hello, world"), HasSubstr("is no capture"));
  EXPECT_THAT(error(CaptureBytes().section().interface(1).packet(0, 1, "x").str()),
              HasSubstr("no packets of link type 250 (RTAC serial), but of 1"));
  // What is wrong in itself alone is left out and told.
  const auto odd = read(head + CaptureBytes()
                                   .packet(7, 1, rtac_packet(kSent, 0, "of nobody"))
                                   .packet(0, 1, "short")
                                   .block(6, CaptureBytes().u32(0).u32(0).u32(0).u32(99).u32(99).str())
                                   .packet(0, 1, rtac_packet(kSent, 0, "good"))
                                   .str());
  ASSERT_TRUE(odd) << odd.error().message;
  EXPECT_EQ(odd->blocks, 1U);
  EXPECT_EQ(odd->problem_count, 3U);
}

}  // namespace
}  // namespace porttape
