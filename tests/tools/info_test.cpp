#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_writer.hpp"
#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using test::TempDir;
using testing::HasSubstr;

std::string sample(const TempDir& dir) {
  return make_tape(dir, "t", {{1'100'000, "answer"}, {2'000'000, "more"}},
                   {{1'000'000, "ask"}, {3'000'000, "again"}},
                   "{\"t_us\":0,\"event\":\"open\"}\n{\"t_us\":10,\"event\":\"gap\",\"bytes\":5}\n"
                   "{\"t_us\":4000000,\"event\":\"close\"}\n");
}

TEST(Info, TellsWhatTheTapeHolds) {
  const TempDir dir;
  const auto ran = run({"info", sample(dir)});
  EXPECT_EQ(ran.status, 0);
  EXPECT_EQ(ran.err, "");
  EXPECT_THAT(ran.out, HasSubstr("duration   4.000000 s"));
  EXPECT_THAT(ran.out,
              HasSubstr("read       2 blocks, 10 bytes, 1.100000 to 2.000000 s, 2.50 B/s, largest block 6"));
  EXPECT_THAT(ran.out, HasSubstr("exchanges  2, 1 answered"));
  EXPECT_THAT(ran.out, HasSubstr("answers    after 100.0 ms to 100.0 ms, median 100.0 ms, p99 100.0 ms"));
  EXPECT_THAT(ran.out, HasSubstr("recorded   2024-05-06T07:08:09Z by porttape 0.1.0 on bench"));
  EXPECT_THAT(ran.out, HasSubstr("events     1 close, 1 gap, 1 open"));
  EXPECT_THAT(ran.out, HasSubstr("gaps       1, 5 bytes missing"));
}

TEST(Info, ListsTheSessions) {
  const TempDir dir;
  const std::string tape =
      make_tape(dir, "t", {{1'100'000, "answer"}, {1'600'000, "nobody's"}, {2'100'000, "more"}},
                {{1'000'000, "ask"}, {2'000'000, "again"}, {2'200'000, "!"}},
                "{\"t_us\":0,\"event\":\"open\"}\n{\"t_us\":1500000,\"event\":\"close\"}\n"
                "{\"t_us\":1900000,\"event\":\"open\"}\n");
  const auto ran = run({"info", tape});
  EXPECT_THAT(ran.out, HasSubstr("sessions   2\n"));
  EXPECT_THAT(ran.out, HasSubstr(" 1  0.000000 to 1.500000 s, 1.50 s, 6 bytes read, 3 written\n"));
  EXPECT_THAT(ran.out,
              HasSubstr(" 2  1.900000 to 2.200000 s (no close), 300.0 ms, 4 bytes read, 6 written\n"));
  const auto json = boost::json::parse(run({"info", "--json", tape}).out).as_object();
  EXPECT_EQ(json.at("session_count").as_int64(), 2);
  const auto& sessions = json.at("sessions").as_array();
  ASSERT_EQ(sessions.size(), 2U);
  EXPECT_EQ(sessions[0].at("open_us").as_int64(), 0);
  EXPECT_EQ(sessions[0].at("close_us").as_int64(), 1'500'000);
  EXPECT_EQ(sessions[0].at("duration_us").as_int64(), 1'500'000);
  EXPECT_EQ(sessions[0].at("read_bytes").as_int64(), 6);
  EXPECT_EQ(sessions[1].at("write_bytes").as_int64(), 6);
  EXPECT_TRUE(sessions[1].at("close_us").is_null());
}

TEST(Info, ATapeWithoutOpensIsOneSession) {
  const TempDir dir;
  const std::string tape = make_tape(dir, "t", {{1, "ab"}}, {{4, "c"}});
  const auto json = boost::json::parse(run({"info", "--json", tape}).out).as_object();
  EXPECT_EQ(json.at("session_count").as_int64(), 1);
  const auto& only = json.at("sessions").at(0);
  EXPECT_TRUE(only.at("open_us").is_null());
  EXPECT_EQ(only.at("duration_us").as_int64(), 4);
  EXPECT_EQ(only.at("read_bytes").as_int64(), 2);
}

TEST(Info, ShowsTheHistoryOfTheSettings) {
  const TempDir dir;
  const std::string tape = make_tape(
      dir, "t", {}, {},
      R"({"t_us":41,"event":"settings","by":"device","baud":9600,"databits":8,"parity":"none","stopbits":1,)"
      R"("hwflowctrl":false,"swflowctrl":false,"order":"exact"})"
      "\n"
      R"({"t_us":1280,"event":"settings","by":"driver","baud":115200,"stopbits":1,"hwflowctrl":true,)"
      R"("swflowctrl":false,"order":"sampled"})"
      "\n"
      R"({"t_us":2000,"event":"settings"})"
      "\n");
  EXPECT_THAT(run({"info", tape}).out,
              HasSubstr("settings   0.000041 s  device: 9600 baud, 8N1\n"
                        "             0.001280 s  driver: 115200 baud, 1 stop bit, RTS/CTS (sampled)\n"
                        "             0.002000 s  line: nothing is known of them\n"));
  const std::string json = run({"info", "--json", tape}).out;
  EXPECT_THAT(
      json,
      HasSubstr(
          R"("settings":[{"t_us":41,"event":"settings","by":"device","baud":9600,"databits":8,)"
          R"("parity":"none","stopbits":1,"hwflowctrl":false,"swflowctrl":false,)"
          R"("order":"exact"},{"t_us":1280,"event":"settings","by":"driver","baud":115200,"stopbits":1,)"
          R"("hwflowctrl":true,"swflowctrl":false,"order":"sampled"},{"t_us":2000,"event":"settings"}])"));
}

TEST(Info, ShowsTheHistoryOfTheSignals) {
  const TempDir dir;
  const std::string first = R"({"t_us":41,"event":"modem","line":"cts","state":"on","by":"device"})";
  const std::string second = R"({"t_us":1280,"event":"break","state":"on","by":"driver"})";
  std::string events = first + "\n" + second + "\n";
  for (int i = 0; i < 100; ++i)
    events += R"({"t_us":2000,"event":"modem","line":"rts","state":"on"})"
              "\n";
  const std::string tape = make_tape(dir, "t", {}, {}, events);
  EXPECT_THAT(run({"info", tape}).out, AllOf(HasSubstr("events     1 break, 101 modem"),
                                             HasSubstr("signals    0.000041 s  device: cts on\n"
                                                       "             0.001280 s  driver: break on\n"
                                                       "             0.002000 s  driver: rts on\n"),
                                             HasSubstr("\n             … and 94 more\n")));
  EXPECT_THAT(run({"info", "--json", tape}).out, HasSubstr(R"("signals":[)" + first + "," + second + ","));
}

TEST(Info, SaysHowManyMoreSettingsThereAre) {
  const TempDir dir;
  std::string events;
  for (int i = 0; i < 100; ++i)
    events += "{\"t_us\":" + std::to_string(i) + R"(,"event":"settings","by":"driver","baud":300})" + "\n";
  const std::string tape = make_tape(dir, "t", {}, {}, events);
  EXPECT_THAT(run({"info", tape}).out,
              HasSubstr("0.000019 s  driver: 300 baud\n             … and 80 more\n"));
  const auto json = boost::json::parse(run({"info", "--json", tape}).out).as_object();
  EXPECT_EQ(json.at("events").at("settings").as_array().size(), 64U);
}

TEST(Info, ShowsMarks) {
  const TempDir dir;
  const std::string tape =
      make_tape(dir, "t", {}, {}, "{\"t_us\":1500000,\"event\":\"mark\",\"text\":\"arm\"}\n");
  EXPECT_THAT(run({"info", tape}).out, HasSubstr("mark       1.500000 s  arm\n"));
  const auto json = boost::json::parse(run({"info", "--json", tape}).out).as_object();
  EXPECT_EQ(json.at("events").at("marks").at(0).at("t_us").as_int64(), 1'500'000);
  EXPECT_EQ(json.at("events").at("marks").at(0).at("text").as_string(), "arm");
}

TEST(Info, JsonSaysTheSame) {
  const TempDir dir;
  const std::string tape = sample(dir);
  const auto ran = run({"info", "--json", tape});
  const auto json = boost::json::parse(ran.out).as_object();
  EXPECT_EQ(json.at("tape").as_string(), tape);
  EXPECT_EQ(json.at("duration_us").as_int64(), 4'000'000);
  EXPECT_EQ(json.at("read").at("bytes").as_int64(), 10);
  EXPECT_EQ(json.at("read").at("bytes_per_s").as_double(), 2.5);
  EXPECT_TRUE(json.at("read").at("damage").is_null());
  EXPECT_EQ(json.at("write").at("first_us").as_int64(), 1'000'000);
  EXPECT_EQ(json.at("latency_us").at("median").as_int64(), 100'000);
  EXPECT_EQ(json.at("events").at("device").as_string(), "serial:/dev/ttyUSB0");
  EXPECT_EQ(json.at("events").at("kinds").at("gap").as_int64(), 1);
  EXPECT_EQ(json.at("events").at("gaps").at(0).at("bytes").as_int64(), 5);
  EXPECT_TRUE(json.at("events").at("id").is_null());
  EXPECT_FALSE(json.at("events").at("ended").as_bool());
  EXPECT_FALSE(json.at("being_written").as_bool());
  EXPECT_FALSE(json.at("sound").as_bool());
  EXPECT_EQ(json.at("verdict").as_string(), "no-damage-found");
  EXPECT_EQ(json.at("damages").as_array().size(), 0U);
  EXPECT_EQ(json.at("notes").as_array().size(), 2U);
}

TEST(Info, TellsTheWholeHeader) {
  const TempDir dir;
  const TapePaths paths = literal_tape(dir / "t.log");
  TapeHeader header{"udp:10.0.0.5:7,timeout=1", "pty"};
  header.id = "0123";
  header.zero = TapeZero{"2024-05-06T07:08:09.000005Z", 1'500'000, "b007"};
  header.transport = Transport::datagram;
  header.stamped = Stamped::read;
  header.previous = PreviousTape{"ff\x1b", "s.log"};
  header.identity = PortIdentity{.path = "/dev/ttyUSB0", .vid = 0x403, .pid = 0x6001, .serial = "P1"};
  ASSERT_TRUE(TapeWriter::create(paths, header, {.sync = false})->finish(tape_time_us(0)));
  const std::string out = run({"info", paths.name()}).out;
  EXPECT_THAT(out, HasSubstr("id         0123\n"));
  EXPECT_THAT(out, HasSubstr("zero       2024-05-06T07:08:09.000005Z, 1.500000 s after the boot b007\n"));
  EXPECT_THAT(out, HasSubstr("device     udp:10.0.0.5:7,timeout=1\n"));
  EXPECT_THAT(out, HasSubstr("transport  datagram\n"));
  EXPECT_THAT(out, HasSubstr("stamped    when bytes were read\n"));
  EXPECT_THAT(out, HasSubstr("previous   s.log ff\\x1b\n"));
  EXPECT_THAT(out, HasSubstr("identity   /dev/ttyUSB0, USB 0403:6001, serial P1\n"));
  EXPECT_THAT(out, HasSubstr("ended      yes\n"));
  EXPECT_THAT(out, HasSubstr("state      sound\n"));
  const auto json = boost::json::parse(run({"info", "--json", paths.name()}).out).as_object();
  const auto& events = json.at("events");
  EXPECT_EQ(events.at("id").as_string(), "0123");
  EXPECT_EQ(events.at("zero").at("monotonic_us").as_int64(), 1'500'000);
  EXPECT_EQ(events.at("zero").at("boot").as_string(), "b007");
  EXPECT_EQ(events.at("transport").as_string(), "datagram");
  EXPECT_EQ(events.at("stamped").as_string(), "read");
  EXPECT_EQ(events.at("previous").at("name").as_string(), "s.log");
  EXPECT_EQ(events.at("identity").at("vid").as_string(), "0403");
  EXPECT_TRUE(events.at("identity").at("driver").is_null());
  EXPECT_TRUE(events.at("ended").as_bool());
  EXPECT_TRUE(json.at("sound").as_bool());
  EXPECT_EQ(json.at("verdict").as_string(), "sound");
}

TEST(Info, JsonOfAnEmptyTapeIsWellFormed) {
  const TempDir dir;
  test::write_file(dir / "odd \"name\xff.logr", {});
  const auto ran = run({"info", "--json", dir / "odd \"name\xff.log"});
  EXPECT_EQ(ran.status, 0);
  const auto json = boost::json::parse(ran.out).as_object();
  EXPECT_TRUE(json.at("write").is_null());
  EXPECT_TRUE(json.at("events").is_null());
  EXPECT_TRUE(json.at("latency_us").is_null());
  EXPECT_TRUE(json.at("read").at("first_us").is_null());
}

TEST(Info, OfSeveralTapesGivesTheWorstStatus) {
  const TempDir dir;
  const std::string good = make_tape(dir, "good", {{1, "a"}}, {});
  const std::string bad = make_tape(dir, "bad", {{2, "a"}, {1, "b"}}, {});
  const auto ran = run({"info", bad, good});
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out, HasSubstr("damage     "));
  EXPECT_THAT(ran.out, HasSubstr(good));
  EXPECT_EQ(run({"info", dir / "none", good}).status, 2);
}

}  // namespace
}  // namespace porttape
