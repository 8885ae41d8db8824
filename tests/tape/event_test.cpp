#include "libport/tape/event.hpp"

#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

struct Example {
  Event event;
  std::string line;  // at 7 us, as FORMAT.md tells it
};

// At least one of each kind, in the order of the variant.
std::vector<Example> examples() {
  const PayloadTotals read{3, 40, 0x0123456789abcdef};
  const PayloadTotals write{1, 2, std::nullopt};
  return {
      {event::Unknown{"hyper\"space"}, R"({"t_us":7,"event":"hyper\"space"})"},
      {event::Open{}, R"({"t_us":7,"event":"open"})"},
      {event::Close{}, R"({"t_us":7,"event":"close"})"},
      {event::DeviceLost{"Input/output error", false},
       R"({"t_us":7,"event":"device-lost","why":"Input/output error"})"},
      {event::DeviceLost{"", true}, R"({"t_us":7,"event":"device-lost","why":"","hung_up":true})"},
      {event::DeviceBack{}, R"({"t_us":7,"event":"device-back"})"},
      {event::HalfClose{Side::driver}, R"({"t_us":7,"event":"half-close","by":"driver"})"},
      {event::HalfClose{Side::device}, R"({"t_us":7,"event":"half-close","by":"device"})"},
      {event::HalfClose{}, R"({"t_us":7,"event":"half-close"})"},
      {event::Zero{{"2024", 9, "b"}},
       R"({"t_us":7,"event":"zero","wall":"2024","monotonic_us":9,"boot":"b"})"},
      {event::Zero{{"2024", 9, ""}}, R"({"t_us":7,"event":"zero","wall":"2024","monotonic_us":9})"},
      {event::Settings{Side::device, SeenSettings::of({}), SettingsOrder::exact},
       R"({"t_us":7,"event":"settings","by":"device","baud":9600,"databits":8,"parity":"none","stopbits":1,)"
       R"("hwflowctrl":false,"swflowctrl":false,"order":"exact"})"},
      {event::Settings{Side::driver,
                       {.baud = 0, .stop_bits = 2, .hw_flow = true, .sw_flow = true},
                       SettingsOrder::sampled},
       R"({"t_us":7,"event":"settings","by":"driver","baud":0,"stopbits":2,"hwflowctrl":true,)"
       R"("swflowctrl":true,"order":"sampled"})"},
      {event::Settings{{}, {.baud = 4'294'967'295, .data_bits = 5, .parity = Parity::space}, {}},
       R"({"t_us":7,"event":"settings","baud":4294967295,"databits":5,"parity":"space"})"},
      {event::Settings{}, R"({"t_us":7,"event":"settings"})"},
      {event::Flush{FlushQueue::in}, R"({"t_us":7,"event":"flush","queue":"in"})"},
      {event::Flush{FlushQueue::out}, R"({"t_us":7,"event":"flush","queue":"out"})"},
      {event::Flush{FlushQueue::both}, R"({"t_us":7,"event":"flush","queue":"both"})"},
      {event::Flush{}, R"({"t_us":7,"event":"flush"})"},
      {event::Modem{LineSignal::Name::dtr, false, Side::driver},
       R"({"t_us":7,"event":"modem","line":"dtr","state":"off","by":"driver"})"},
      {event::Modem{LineSignal::Name::ri, true, {}},
       R"({"t_us":7,"event":"modem","line":"ri","state":"on"})"},
      {event::Modem{}, R"({"t_us":7,"event":"modem"})"},
      {event::Break{true, Side::device}, R"({"t_us":7,"event":"break","state":"on","by":"device"})"},
      {event::Drain{Micros{1234}}, R"({"t_us":7,"event":"drain","took_us":1234})"},
      {event::Fault{{.kind = "corrupt", .spec = "corrupt:byte=3", .dir = LineDir::w, .offset = 3}},
       R"({"t_us":7,"event":"fault","kind":"corrupt","dir":"w","offset":3,"spec":"corrupt:byte=3"})"},
      {event::Fault{{.kind = "plan", .spec = "drop:p=1", .seed = 0}},
       R"({"t_us":7,"event":"fault","kind":"plan","spec":"drop:p=1","seed":0})"},
      {event::Fault{{.kind = "more", .count = 9}}, R"({"t_us":7,"event":"fault","kind":"more","count":9})"},
      {event::Mark{"a\x1b\"\n"}, R"({"t_us":7,"event":"mark","text":"a\u001b\"\n"})"},
      {event::Gap{512, tape_time_us(3), "disk full"},
       R"({"t_us":7,"event":"gap","bytes":512,"from_us":3,"why":"disk full"})"},
      {event::Gap{}, R"({"t_us":7,"event":"gap","bytes":0,"why":""})"},
      {event::End{read, write, {}},
       R"({"t_us":7,"event":"end","read":{"blocks":3,"bytes":40,"xxh3":"0123456789abcdef"},)"
       R"("write":{"blocks":1,"bytes":2}})"},
      {event::End{}, R"({"t_us":7,"event":"end"})"},
  };
}

Event decoded(const std::string& line) {
  const auto event = decode_event(line);
  if (!event) throw std::runtime_error(event.error().message);
  return event->what;
}

TEST(Event, EveryKindIsWrittenAsFormatMdTellsAndReadBack) {
  std::vector<std::size_t> kinds;
  for (const auto& [event, line] : examples()) {
    EXPECT_EQ(encode(tape_time_us(7), event), line + '\n');
    const auto back = decode_event(line);
    ASSERT_TRUE(back) << line;
    EXPECT_EQ(back->at, tape_time_us(7));
    EXPECT_EQ(back->what, event) << line;
    if (kinds.empty() || kinds.back() != event.index()) kinds.push_back(event.index());
  }
  EXPECT_THAT(kinds, SizeIs(std::variant_size_v<Event>)) << "a kind without an example";
}

const std::string kSealed =
    R"({"t_us":7,"event":"end","read":{"blocks":3,"bytes":40,"xxh3":"0123456789abcdef","xxh3_all":"00000000000000ff"},)"
    R"("write":{"blocks":0,"bytes":0},"events_xxh3":"000000000000000a")";
std::string sealed_line() {
  return kSealed + R"(,"line_xxh3":")" + digest_text(digest_of(as_bytes(kSealed))) + "\"}";
}

TEST(Event, AnEndThatTellsOfOtherLinesIsSealed) {
  const event::End end{PayloadTotals{3, 40, 0x0123456789abcdef, 0xff}, PayloadTotals{0, 0, std::nullopt}, 10};
  EXPECT_EQ(encode(tape_time_us(7), end), sealed_line() + '\n');
  EXPECT_EQ(decoded(sealed_line()), Event(end));
  EXPECT_TRUE(check_seal(sealed_line(), end));
}

TEST(Event, ABrokenSealIsTold) {
  const auto flaw = [](const std::string& line) {
    const auto event = decode_event(line);
    const Result<void> sealed = event ? check_seal(line, event->what) : Result<void>(event.error());
    return sealed ? "" : sealed.error().message;
  };
  const std::string another = "the line is not as it was written: its own digest, line_xxh3, is another";
  const std::string missing = "the line is not as it was written: its own digest, line_xxh3, is missing";
  EXPECT_EQ(flaw(sealed_line()), "");
  std::string line = sealed_line();
  line[8] = '8';
  EXPECT_EQ(flaw(line), another);
  line = sealed_line();
  line[line.find("end")] = 'a';
  EXPECT_EQ(flaw(line), another) << "of any kind";
  EXPECT_EQ(flaw(kSealed + "}"), missing);
  EXPECT_EQ(flaw(R"({"t_us":7,"event":"end","read":{"blocks":0,"bytes":0},"write":{"blocks":0,"bytes":0}})"),
            "")
      << "it tells of no other lines";
}

TEST(Event, AnEndThatIsMovedVouchesForNoOtherLines) {
  const std::string moved = encode_again(sealed_line(), tape_time_us(9));
  EXPECT_EQ(moved, R"({"t_us":9,"event":"end","read":{"blocks":3,"bytes":40,"xxh3":"0123456789abcdef",)"
                   R"("xxh3_all":"00000000000000ff"},"write":{"blocks":0,"bytes":0}})"
                   "\n");
  EXPECT_TRUE(check_seal(moved.substr(0, moved.size() - 1), decoded(moved.substr(0, moved.size() - 1))));
}

TEST(Event, UnknownKeysAndAnyOrderAreReadAsIfTheyWereNotThere) {
  for (const auto& [event, line] : examples()) {
    const std::string members = line.substr(1, line.size() - 2);
    EXPECT_EQ(decoded("{\"new\":{\"why\":[1,2]}," + members + ",\"newer\":null}"), event) << line;
  }
  EXPECT_EQ(decoded(R"({"why":"x","from_us":3,"event":"gap","bytes":5,"t_us":7})"),
            Event(event::Gap{5, tape_time_us(3), "x"}));
}

TEST(Event, WhatAKeySaysOddlyIsNotTold) {
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"gap","bytes":-1,"from_us":"3","why":4})"), Event(event::Gap{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"flush","queue":"sideways"})"), Event(event::Flush{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"half-close","by":7})"), Event(event::HalfClose{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"device-lost","hung_up":"yes"})"), Event(event::DeviceLost{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"mark"})"), Event(event::Mark{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"settings","by":"me","baud":4294967296,"databits":9,"parity":"E",)"
                    R"("stopbits":0,"hwflowctrl":1,"swflowctrl":"on","order":7})"),
            Event(event::Settings{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"settings","baud":-1,"databits":4,"stopbits":3})"),
            Event(event::Settings{}));
  EXPECT_EQ(decoded(R"({"t_us":7,"event":"zero"})"), Event(event::Zero{}));
}

TEST(Event, WhatAnEndSaysOddlyIsNotTold) {
  const auto totals = [](const std::string& read) {
    return std::get<event::End>(decoded(R"({"t_us":0,"event":"end","read":)" + read + "}")).read;
  };
  EXPECT_FALSE(totals("7"));
  EXPECT_FALSE(totals("{}"));
  EXPECT_FALSE(totals(R"({"blocks":-1,"bytes":1})"));
  EXPECT_EQ(totals(R"({"blocks":1,"bytes":1,"xxh3":"xyz"})"), (PayloadTotals{1, 1, std::nullopt}));
  EXPECT_EQ(totals(R"({"blocks":1,"bytes":1,"xxh3":"00000000000000ff","new":1})"),
            (PayloadTotals{1, 1, 255}));
}

TEST(Event, ALongTextIsCutBetweenTwoCharacters) {
  const std::string text = std::string(4095, 'x') + "\u00e9";
  EXPECT_EQ(decoded(encode(tape_time_us(1), event::Mark{text})), Event(event::Mark{std::string(4095, 'x')}));
}

TEST(Event, ALineThatIsNoneIsDamage) {
  for (const char* line : {"", "nonsense", "[1]", "7", R"({"t_us":1,"event":"open")"}) {
    EXPECT_EQ(decode_event(line).error().message, "not a JSON object") << line;
  }
  EXPECT_THAT(decode_event(R"({"event":"open"})").error().message, HasSubstr("no t_us"));
  EXPECT_EQ(decode_event(R"({"t_us":1,"event":7})").error().message, "no event");
  EXPECT_EQ(decode_event(R"({"t_us":1})").error().code, Errc::damaged_tape);
}

TEST(TapeHeader, IsReadBack) {
  const TapeHeader bare{"serial:/dev/ttyUSB0", "pty:/tmp/x", "2024", "bench", "porttape 1"};
  EXPECT_EQ(decode_header(encode(bare)).value(), bare);
  TapeHeader full = bare;
  full.id = "8f14e45fceea167a5a36dedd4bea2543";
  full.zero = TapeZero{"2024-05-06T07:08:08.999871Z", 86'400'123'456, "5c0e"};
  full.transport = Transport::datagram;
  full.stamped = Stamped::read;
  full.previous = PreviousTape{"45c4", "laser.log"};
  full.identity = PortIdentity{.path = "/dev/ttyUSB0",
                               .vid = 0x0403,
                               .pid = 0x6001,
                               .serial = "PT1",
                               .manufacturer = "FTDI",
                               .product = "FT232R",
                               .interface = std::uint8_t{1},
                               .driver = "ftdi_sio"};
  EXPECT_EQ(decode_header(encode(full)).value(), full);
  full.identity = PortIdentity{.path = "/dev/ttyS0"};
  EXPECT_EQ(decode_header(encode(full)).value(), full);
  EXPECT_EQ(decode_header("{}").error().message,
            "not an events file: its first line is no porttape-events header");
  EXPECT_EQ(decode_header(R"({"format":"porttape-events","version":2})").error().message,
            "an events file of version 2; this porttape reads version 1");
}

}  // namespace
}  // namespace porttape
