// Lines of the events file at the limits of what they can say, and lines that are written again.

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/line/line_settings_text.hpp"
#include "libport/tape/event.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::Not;

Event event_in(const std::string& members) {
  const auto event = decode_event(R"({"t_us":7,)" + members + "}");
  if (!event) throw std::runtime_error(event.error().message);
  return event->what;
}

TEST(EventLines, NumbersCountUpToTheirLimits) {
  const auto settings = [](const std::string& members) {
    return std::get<event::Settings>(event_in(R"("event":"settings",)" + members)).line;
  };
  EXPECT_EQ(settings(R"("databits":5)").data_bits, 5U);
  EXPECT_EQ(settings(R"("databits":8)").data_bits, 8U);
  EXPECT_EQ(settings(R"("databits":4)").data_bits, std::nullopt);
  EXPECT_EQ(settings(R"("databits":9)").data_bits, std::nullopt);
  EXPECT_EQ(settings(R"("stopbits":1)").stop_bits, 1U);
  EXPECT_EQ(settings(R"("stopbits":2)").stop_bits, 2U);
  EXPECT_EQ(settings(R"("stopbits":3)").stop_bits, std::nullopt);
  EXPECT_EQ(settings(R"("baud":0)").baud, 0U);
  EXPECT_EQ(settings(R"("baud":4294967295)").baud, 4'294'967'295U);
  EXPECT_EQ(settings(R"("baud":4294967296)").baud, std::nullopt);
  for (const Parity parity : {Parity::none, Parity::even, Parity::odd, Parity::mark, Parity::space})
    EXPECT_EQ(settings(R"("parity":")" + std::string(to_string(parity)) + "\"").parity, parity);
}

TEST(EventLines, WhatIsNotThereIsNothing) {
  EXPECT_EQ(event_in(R"("event":"drain")"), Event(event::Drain{}));
  EXPECT_EQ(event_in(R"("event":"drain","took_us":-1)"), Event(event::Drain{}));
  EXPECT_EQ(event_in(R"("event":"gap")"), Event(event::Gap{}));
  EXPECT_EQ(event_in(R"("event":"fault")"), Event(event::Fault{}));
  EXPECT_EQ(event_in(R"("event":"zero","monotonic_us":-1)"), Event(event::Zero{}));
  EXPECT_EQ(event_in(R"("event":"device-lost")"), Event(event::DeviceLost{}));
  EXPECT_EQ(event_in(R"("event":"modem","line":"brk","state":"up","by":"us")"), Event(event::Modem{}));
  EXPECT_EQ(event_in(R"("event":"break")"), Event(event::Break{}));
  EXPECT_EQ(event_in(R"("event":"device-lost","hung_up":false)"), Event(event::DeviceLost{}));
}

TEST(EventLines, AGapThatBeganBeforeItsTapeBeginsWithIt) {
  EXPECT_EQ(event_in(R"("event":"gap","from_us":-5)"), Event(event::Gap{0, tape_time_us(0), ""}));
  EXPECT_EQ(event_in(R"("event":"gap","from_us":1)"), Event(event::Gap{0, tape_time_us(1), ""}));
}

TEST(EventLines, AnEndTellsBlocksAndBytesOrNothing) {
  const auto read = [](const std::string& totals) {
    return std::get<event::End>(event_in(R"("event":"end","read":)" + totals)).read;
  };
  EXPECT_EQ(read(R"({"blocks":1})"), std::nullopt);
  EXPECT_EQ(read(R"({"bytes":1})"), std::nullopt);
  EXPECT_EQ(read(R"({"blocks":0,"bytes":0})"), (PayloadTotals{0, 0, std::nullopt}));
}

TEST(EventLines, ADigestIs16HexadecimalDigits) {
  const auto digest = [](const std::string& hex) {
    return std::get<event::End>(
               event_in(R"("event":"end","write":{"blocks":1,"bytes":1,"xxh3":")" + hex + "\"}"))
        .write->xxh3;
  };
  EXPECT_EQ(digest("ffffffffffffffff"), 0xffff'ffff'ffff'ffffU);
  EXPECT_EQ(digest("0000000000000010"), 16U);
  for (const char* hex : {"000000000000010", "00000000000000100", "000000000000001g", "zzzzzzzzzzzzzzzz",
                          "-000000000000010", "0x00000000000010", " 000000000000010"})
    EXPECT_EQ(digest(hex), std::nullopt) << hex;
}

TEST(EventLines, ALongTextIsCutAt4096BytesAndNeverInACharacter) {
  const auto kept = [](const std::string& text) {
    return std::get<event::Mark>(decode_event(encode(tape_time_us(1), event::Mark{text}))->what).text.raw();
  };
  const std::string four = "\U0001f600";
  for (const std::size_t before : {4096U, 4095U, 4094U, 4093U})
    EXPECT_EQ(kept(std::string(before, 'x') + four), std::string(before, 'x')) << before;
  EXPECT_EQ(kept(std::string(4092, 'x') + four), std::string(4092, 'x') + four);
  EXPECT_EQ(kept(std::string(4097, 'x')), std::string(4096, 'x'));
  std::string replaced;  // what is no character at all is cut near there
  for (int i = 0; i < 4092; ++i) replaced += "\xEF\xBF\xBD";
  EXPECT_EQ(kept(std::string(5000, '\x80')), replaced);
  EXPECT_EQ(kept(std::string(4096, 'x')), std::string(4096, 'x'));
}

TEST(EventLines, ASignalIsAnEventAndBack) {
  using Name = LineSignal::Name;
  for (const Side by : {Side::driver, Side::device}) {
    for (const bool on : {false, true}) {
      for (const Name name : {Name::dtr, Name::rts, Name::cts, Name::dsr, Name::cd, Name::ri, Name::brk}) {
        const TapedSignal signal{by, {name, on}};
        const Event event = signal_event(signal);
        EXPECT_EQ(name_of(event), name == Name::brk ? "break" : "modem");
        EXPECT_EQ(signal_of(event), signal);
        EXPECT_EQ(signal_of(decode_event(encode(tape_time_us(1), event))->what), signal);
      }
    }
  }
}

TEST(EventLines, ASignalIsThatOfTheSideThatHasTheLineWhereNobodyIsNamed) {
  using Name = LineSignal::Name;
  for (const Name name : {Name::dtr, Name::rts})
    EXPECT_EQ(signal_of(event::Modem{name, true, {}}), (TapedSignal{Side::driver, {name, true}}));
  for (const Name name : {Name::cts, Name::dsr, Name::cd, Name::ri})
    EXPECT_EQ(signal_of(event::Modem{name, false, {}}), (TapedSignal{Side::device, {name, false}}));
  EXPECT_EQ(signal_of(event::Break{true, {}}), (TapedSignal{Side::driver, {Name::brk, true}}));
}

TEST(EventLines, WhatIsNotWhollyKnownIsNoSignal) {
  EXPECT_EQ(signal_of(event::Modem{{}, true, Side::driver}), std::nullopt);
  EXPECT_EQ(signal_of(event::Modem{LineSignal::Name::dtr, {}, Side::driver}), std::nullopt);
  EXPECT_EQ(signal_of(event::Break{{}, Side::driver}), std::nullopt);
  EXPECT_EQ(signal_of(event::Open{}), std::nullopt);
}

TEST(EventLines, WhatWasDoneToTheLineCanBeDoneAgain) {
  const auto fast = line_event_of(event::Settings{Side::device, SeenSettings{.baud = 115'200}, {}});
  ASSERT_TRUE(fast);
  EXPECT_EQ(fast->by, Side::device);
  EXPECT_EQ(std::get<line::Settings>(fast->what), (line::Settings{{.baud = 115'200}, SettingsOrder::exact}));
  const auto seen = line_event_of(event::Settings{Side::driver, {}, SettingsOrder::sampled});
  ASSERT_TRUE(seen);
  EXPECT_EQ(std::get<line::Settings>(seen->what).order, SettingsOrder::sampled);
  const auto flushed = line_event_of(event::Flush{FlushQueue::in});
  ASSERT_TRUE(flushed);
  EXPECT_EQ(flushed->by, Side::driver);
  EXPECT_EQ(std::get<line::Flush>(flushed->what).queue, FlushQueue::in);
  EXPECT_EQ(std::get<line::Flush>(line_event_of(event::Flush{})->what).queue, FlushQueue::both);
  const auto signal = line_event_of(event::Break{true, Side::device});
  ASSERT_TRUE(signal);
  EXPECT_EQ(signal->by, Side::device);
  EXPECT_EQ(std::get<LineSignal>(signal->what), (LineSignal{LineSignal::Name::brk, true}));
}

TEST(EventLines, WhatWasDoneToTheLineIsAnEventOfTheTape) {
  const auto flush = event_of(TapedLineEvent{Side::driver, line::Flush{FlushQueue::out}});
  EXPECT_EQ(flush, Event(event::Flush{FlushQueue::out}));
  const line::Settings seen{{.baud = 300}, SettingsOrder::sampled};
  EXPECT_EQ(event_of(TapedLineEvent{Side::driver, seen}),
            Event(event::Settings{Side::driver, {.baud = 300}, SettingsOrder::sampled}));
  EXPECT_EQ(event_of(TapedLineEvent{Side::device, LineSignal{LineSignal::Name::cts, true}}),
            Event(event::Modem{LineSignal::Name::cts, true, Side::device}));
  EXPECT_EQ(event_of(TapedLineEvent{Side::driver, LineSignal{LineSignal::Name::brk, false}}),
            Event(event::Break{false, Side::driver}));
  EXPECT_EQ(event_of(TapedLineEvent{Side::device, line::Dropped{7, "no room"}}),
            Event(event::Gap{7, std::nullopt, std::string("no room")}));
  EXPECT_EQ(event_of(TapedLineEvent{Side::device, LineFault{.kind = "drop"}}),
            Event(event::Fault{{.kind = "drop"}}));
  EXPECT_EQ(event_of(TapedLineEvent{Side::device, line::Mark{"here"}}),
            Event(event::Mark{std::string("here")}));
}

TEST(EventLines, WhatNoTapeHoldsOrNotFromThatSideIsNone) {
  EXPECT_EQ(event_of(TapedLineEvent{Side::device, line::Flush{}}), std::nullopt);
  EXPECT_EQ(event_of(TapedLineEvent{Side::driver, line::Dropped{7, "no room"}}), std::nullopt);
  EXPECT_EQ(event_of(TapedLineEvent{Side::driver, LineFault{.kind = "drop"}}), std::nullopt);
  EXPECT_EQ(event_of(TapedLineEvent{Side::driver, line::Drain{1}}), std::nullopt);
  EXPECT_EQ(event_of(TapedLineEvent{Side::device, line::WatchSignals{}}), std::nullopt);
}

TEST(EventLines, WhatNobodyIsKnownToHaveDoneCannotBeDoneAgain) {
  EXPECT_FALSE(line_event_of(event::Settings{{}, SeenSettings{.baud = 115'200}, {}}));
  EXPECT_FALSE(line_event_of(event::Modem{}));
  EXPECT_FALSE(line_event_of(event::Mark{"here"}));
}

std::string again(std::string_view line, std::int64_t us) { return encode_again(line, tape_time_us(us)); }

TEST(EventLines, ALineIsWrittenAgainAtAnotherTimeWithAllItsKeys) {
  EXPECT_EQ(again(R"({"deep":[1,{"a":null}],"t_us":5,"event":"snow","from_us":3})", 8),
            "{\"deep\":[1,{\"a\":null}],\"t_us\":8,\"event\":\"snow\",\"from_us\":3}\n");
  EXPECT_EQ(again("no line", 8), "null\n");
}

TEST(EventLines, AGapsBeginMovesWithIt) {
  EXPECT_EQ(again(R"({"t_us":5,"event":"gap","from_us":3})", 8),
            "{\"t_us\":8,\"event\":\"gap\",\"from_us\":6}\n");
  EXPECT_EQ(again(R"({"t_us":5,"event":"gap","from_us":3})", 1),
            "{\"t_us\":1,\"event\":\"gap\",\"from_us\":-1}\n");
  EXPECT_EQ(again(R"({"t_us":5,"event":"gap"})", 8), "{\"t_us\":8,\"event\":\"gap\"}\n");
  EXPECT_EQ(again(R"({"event":"gap","from_us":3})", 8), "{\"event\":\"gap\",\"from_us\":3,\"t_us\":8}\n");
  EXPECT_EQ(again(R"({"t_us":5,"event":"gap","from_us":9223372036854775807})", 8),
            "{\"t_us\":8,\"event\":\"gap\",\"from_us\":9223372036854775807}\n");
  EXPECT_EQ(again(R"({"t_us":5,"event":"gap","from_us":"3"})", 8),
            "{\"t_us\":8,\"event\":\"gap\",\"from_us\":\"3\"}\n");
}

TEST(EventLines, WhatIsCarriedSaysSo) {
  const std::string line = encode_carried(R"({"t_us":5,"event":"open","new":1})", tape_time_us(8));
  EXPECT_EQ(line, "{\"t_us\":8,\"event\":\"open\",\"new\":1,\"carried\":true}\n");
  EXPECT_TRUE(is_carried(line));
  EXPECT_EQ(encode_carried("no line", tape_time_us(8)), "null\n");
  for (const char* other :
       {R"({"t_us":5,"event":"open"})", R"({"t_us":5,"event":"open","carried":false})",
        R"({"t_us":5,"event":"open","carried":1})", R"({"t_us":5,"event":"mark","text":"\"carried\""})",
        R"({"t_us":5,"event":"mark","text":"carried"})", R"("carried")", R"(["carried"])"})
    EXPECT_FALSE(is_carried(other)) << other;
}

TEST(EventLines, AHeaderIsWrittenAgainAsThatOfAnotherTape) {
  TapeHeader other{.device = "other", .driver = "other", .created = "2025", .id = "new"};
  const std::string line =
      R"({"format":"porttape-events","version":1,"created":"2024","id":"old",)"
      R"("zero":{"wall":"w","monotonic_us":1},"device":"d","driver":"p",)"
      R"("previous":{"id":"i","name":"n"},"colour":"red","origin":{"by":"cut","tapes":[]}})";
  const std::string bare = encode_again(line, other);
  EXPECT_EQ(*decode_header(bare), (TapeHeader{.device = "d", .driver = "p", .created = "2025", .id = "new"}));
  EXPECT_THAT(bare, HasSubstr(R"("colour":"red")"));
  other.zero = TapeZero{"v", 2, "b"};
  other.previous = PreviousTape{"j", "m"};
  other.origin = TapeOrigin{"split", {{"k", "l"}}, Micros(5)};
  const auto made = decode_header(encode_again(line, other));
  ASSERT_TRUE(made);
  EXPECT_EQ(made->zero, other.zero);
  EXPECT_EQ(made->previous, other.previous);
  EXPECT_EQ(made->origin, other.origin);
  EXPECT_EQ(made->device, "d");
  EXPECT_EQ(encode_again("no line", other), encode(other));
}

TEST(EventLines, AHeaderTellsWhatATapeWasMadeOf) {
  TapeHeader header{.device = "d", .driver = "p"};
  for (const TapeOrigin& origin :
       {TapeOrigin{"cut", {{"id1", "a"}}, Micros(0)}, TapeOrigin{"merge", {{"", "a"}, {"id2", "b"}}, {}},
        TapeOrigin{"", {}, {}}}) {
    header.origin = origin;
    EXPECT_EQ(decode_header(encode(header))->origin, origin);
  }
  header.origin = TapeOrigin{"merge", {{"", "a"}, {"id2", "b"}}, Micros(7)};
  EXPECT_THAT(
      encode(header),
      HasSubstr(R"("origin":{"by":"merge","tapes":[{"name":"a"},{"id":"id2","name":"b"}],"from_us":7})"));
}

TEST(EventLines, WhatAHeaderSaysOddlyIsNotTold) {
  const auto header = [](const std::string& members) {
    return decode_header(R"({"format":"porttape-events","version":1,)" + members + "}").value();
  };
  EXPECT_EQ(header(R"("zero":5,"previous":"x","identity":[],"origin":null,"transport":"tram","stamped":7)"),
            (TapeHeader{.device = "", .driver = ""}));
  const auto origin = header(R"("origin":{"by":7,"tapes":[5,{"id":1,"name":"a"},"x"],"from_us":-1})").origin;
  EXPECT_EQ(origin, (TapeOrigin{"", {{"", "a"}}, {}}));
  EXPECT_EQ(header(R"("origin":{"tapes":{}})").origin, (TapeOrigin{"", {}, {}}));
  const auto identity = [&](const std::string& members) {
    return *header(R"("identity":{"path":"/dev/a",)" + members + "}").identity;
  };
  const std::string usb = R"("vid":"0403","pid":"6001",)";
  EXPECT_EQ(identity(usb + R"("interface":0)").interface, std::uint8_t{0});
  EXPECT_EQ(identity(usb + R"("interface":255)").interface, std::uint8_t{255});
  EXPECT_EQ(identity(usb + R"("interface":256)").interface, std::nullopt);
  EXPECT_EQ(identity(R"("vid":"04032","pid":1)"), PortIdentity{.path = "/dev/a"});
  EXPECT_EQ(identity(usb + R"("serial":7)").vid, 0x0403);
  EXPECT_EQ(identity(usb + R"("serial":7)").pid, 0x6001);
}

// A tape may be anybody's, and of its identity names and commands are made.
TEST(EventLines, AnIdentityThatCannotBeIsRefusedWithTheReason) {
  const auto header = [](const std::string& members) {
    return decode_header(R"({"format":"porttape-events","version":1,"identity":{)" + members + "}}").value();
  };
  const std::vector<std::pair<std::string, std::string>> rows{
      {R"("path":"/dev/ttyUSB0;touch PWNED;#")", "has other characters than letters, digits and _.:+@-"},
      {R"("path":"/dev/ttyUSB0\n")", "has control characters"},
      {R"("serial":"1")", "is not below /dev"},
      {R"("path":"/dev/a","vid":"0403")", "has a vid and no pid"},
      {R"("path":"/dev/a","vid":"1","pid":"1","driver":"a b")", "is not a driver's name"}};
  for (const auto& [members, reason] : rows) {
    EXPECT_EQ(header(members).identity, std::nullopt) << members;
    EXPECT_THAT(header(members).identity_refused.raw(), HasSubstr(reason)) << members;
  }
  EXPECT_EQ(header(R"("path":"/dev/a")").identity_refused, "");
}

TEST(EventLines, OfTheTapesItWasMadeOfTheFirst1000AreRead) {
  TapeHeader header{.device = "d", .driver = "p"};
  header.origin = TapeOrigin{"merge", std::vector<PreviousTape>(1001, PreviousTape{"", "a"}), {}};
  EXPECT_EQ(decode_header(encode(header))->origin->tapes.size(), 1000U);
}

TEST(EventLines, AnotherVersionIsNamed) {
  const auto error = [](const char* line) { return decode_header(line).error(); };
  EXPECT_EQ(error(R"({"format":"porttape-events","version":0})").message,
            "an events file of version 0; this porttape reads version 1");
  EXPECT_EQ(error(R"({"format":"porttape-events","version":"1"})").message,
            "an events file of version ?; this porttape reads version 1");
  EXPECT_EQ(error(R"({"format":"porttape-events"})").code, Errc::not_a_tape);
  for (const char* none : {"", "[]", R"({"format":"porttape"})", R"({"format":1,"version":1})"})
    EXPECT_EQ(error(none).code, Errc::damaged_tape) << none;
}

TEST(EventLines, WhatAHeaderDoesNotTellIsNotWritten) {
  const std::string line = encode(TapeHeader{.device = "d", .driver = "p"});
  EXPECT_EQ(
      line,
      R"({"format":"porttape-events","version":1,"created":"","device":"d","driver":"p","host":"","tool":""})"
      "\n");
  TapeHeader header{.device = "d", .driver = "p"};
  header.identity = PortIdentity{.path = "x"};
  EXPECT_THAT(encode(header), HasSubstr(R"("identity":{"path":"x"},)"));
}

}  // namespace
}  // namespace porttape
