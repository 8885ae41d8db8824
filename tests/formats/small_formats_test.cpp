#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/formats/base64.hpp"
#include "libport/formats/saleae_value.hpp"
#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::exported;
using test::imported;
using test::lines_of;
using test::MemoryTape;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

class SmallFormatsTest : public testing::Test {
 protected:
  Result<ImportedTape> read(const char* format, const std::string& text, const std::string& device = "",
                            std::optional<unsigned> bytes_at = {}) {
    ImportOptions options;
    if (!device.empty()) options.device = device;
    options.bytes_at = bytes_at;
    return imported(dir, "t" + std::to_string(++made_), format, text, options);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(SmallFormatsTest, SaleaesFirstForm) {
  const std::string table =
      "Time [s],Value,Parity Error,Framing Error\r\n"
      "-0.000100,'A' (0x41),,\r\n"
      "0.000900,COMMA,,\r\n"
      "0.001900,\\r,,\r\n"
      "0.101900,'5' (0x35),Error,\r\n";
  EXPECT_EQ(detect_format(table, ""), find_format("saleae"));
  const auto made = read("saleae", table, "", 9600);
  EXPECT_THAT(lines_of(made), ElementsAre("r 3041 A,\\r", HasSubstr("are the device's"), "r 103041 5"));
  EXPECT_THAT(made->problems, ElementsAre(HasSubstr("evidence:5: a byte with parity error")));
  EXPECT_THAT(read("saleae", table)->blocks, 4U);
}

TEST_F(SmallFormatsTest, SaleaesNewerForm) {
  const std::string table =
      "name,type,start_time,duration,\"data\",\"error\"\n"
      "\"Async RX\",\"data\",0.001,0.00001,0x4F,\n"
      "\"Async RX\",\"data\",0.0010100,0.00001,0x4B,\n"
      "\"Async TX\",\"frame\",0.5,0.00001,,\n"
      "\"Async TX\",\"data\",0.5,0.00001,0x41,framing\n";
  EXPECT_EQ(detect_format(table, ""), find_format("saleae"));
  const auto made = read("saleae", table);
  EXPECT_THAT(lines_of(made), ElementsAre("r 1020 OK", "w 500000 A"));
  EXPECT_THAT(made->guesses, ElementsAre());
  EXPECT_THAT(made->problems, ElementsAre(HasSubstr("(framing)")));
  EXPECT_THAT(lines_of(read("saleae", table, "tx=Async RX")), ElementsAre("w 1000 OK"));
}

TEST_F(SmallFormatsTest, SaleaesTimesOfDay) {
  const auto made = read("saleae",
                         "name,type,start_time,duration,data\n"
                         "tx,data,2024-05-06T07:08:09.000000500+00:00,0.0001,0x41\n"
                         "tx,data,2024-05-06T09:08:10.250000000+02:00,0.0001,0x42\n");
  EXPECT_THAT(lines_of(made), ElementsAre("w 0 A", "w 1250000 B"));
  EXPECT_THAT(test::header_line_of(made->paths), HasSubstr("\"wall\":\"2024-05-06T07:08:09.000000Z\""));
}

TEST_F(SmallFormatsTest, SaleaesValues) {
  EXPECT_EQ(saleae_value("0b  0100 0001", false), Byte{0x41});
  EXPECT_EQ(saleae_value("65", true), Byte{65});
  EXPECT_EQ(saleae_value("5", false), Byte{'5'});
  EXPECT_EQ(saleae_value("' '", false), Byte{' '});
  EXPECT_EQ(saleae_value("'\\r' (13)", false), Byte{13});
  for (const char* const wrong : {"", "0x100", "256", "AB", "0b2", "( )"}) {
    EXPECT_FALSE(saleae_value(wrong, false)) << wrong;
  }
  EXPECT_THAT(lines_of(read("saleae", "Time [s],Value\n0,5\n1,65\n", "rx=")),
              ElementsAre(HasSubstr("'rx=' is wrong")));
  EXPECT_THAT(lines_of(read("saleae", "Time [s],Value\n0,5\n1,65\n")), testing::Contains("r 0 \\x05"));
}

TEST_F(SmallFormatsTest, SaleaesMistakesHaveLineAndColumn) {
  const auto error = [&](const std::string& text) {
    const auto made = read("saleae", text);
    return made ? "" : made.error().message;
  };
  EXPECT_THAT(error("a,b\n"), HasSubstr("is no table of Saleae's"));
  EXPECT_THAT(error("Time [s],Value\nx,65\n"), HasSubstr("evidence:2:1: "));
  EXPECT_THAT(error("Time [s],Value\n1,banana\n"), HasSubstr("evidence:2:3: "));
  EXPECT_THAT(error("Time [s],Value\n1\n"), HasSubstr("evidence:2:1: "));
  EXPECT_THAT(error("Time [s],Value\n1e300,A\n"), HasSubstr("evidence:2:1: "));
}

TEST_F(SmallFormatsTest, ReserialBothWays) {
  const TapePaths paths = test::write_tape(
      literal_tape(dir / "t"),
      MemoryTape().open(0).write(1, "AT").write(2, std::string("\0\xff", 2)).read(3, "OK\r\n").read(9, "x"),
      {});
  const std::string text = exported(paths, "pytest-reserial");
  EXPECT_EQ(text, "{\"test_tape\": {\"rx\": \"T0sNCng=\", \"tx\": \"QVQA/w==\"}}\n");
  EXPECT_EQ(detect_format(text, ""), find_format("pytest-reserial"));
  const auto made = read("pytest-reserial", text);
  EXPECT_THAT(lines_of(made),
              testing::IsSupersetOf({std::string("w 1 AT\\x00\\xff"), std::string("r 2 OK\\r\\nx")}));
  EXPECT_EQ(made->guesses.size(), 2U);
}

TEST_F(SmallFormatsTest, ReserialOfSeveralTests) {
  const std::string text = R"({"test_a": {"rx": [65, 66], "tx": []}, "test_b": {"rx": "", "tx": "QQ=="}})";
  EXPECT_THAT(read("pytest-reserial", text).error().message, HasSubstr("which: test_a, test_b"));
  EXPECT_THAT(lines_of(read("pytest-reserial", text, "test_a")), testing::Contains("r 1 AB"));
  EXPECT_THAT(lines_of(read("pytest-reserial", text, "test_b", 9600)), testing::Contains("w 1041 A"));
  EXPECT_THAT(read("pytest-reserial", R"({"a": {"rx": "Q", "tx": ""}})").error().message,
              HasSubstr("base64"));
  EXPECT_THAT(read("pytest-reserial", "[]").error().message, HasSubstr("no JSON object"));
  EXPECT_THAT(read("pytest-reserial", "{}").error().message, HasSubstr("no test with rx and tx"));
}

std::string little(std::uint64_t number, int size) {
  std::string bytes;
  for (int i = 0; i < size; ++i) bytes += static_cast<char>(number >> (8 * i) & 0xffU);
  return bytes;
}

std::string mcap_text(std::string_view text) { return little(text.size(), 4) + std::string(text); }

std::string mcap_record(char op, const std::string& content) {
  return std::string(1, op) + little(content.size(), 8) + content;
}

std::string mcap_message(int channel, std::uint64_t ns, std::string_view data) {
  return mcap_record(5, little(static_cast<std::uint64_t>(channel), 2) + little(0, 4) + little(ns, 8) +
                            little(ns, 8) + std::string(data));
}

std::string mcap_chunk(std::string_view compression, const std::string& records) {
  return mcap_record(6, little(0, 8) + little(0, 8) + little(records.size(), 8) + little(0, 4) +
                            mcap_text(compression) + little(records.size(), 8) + records);
}

std::string mcap_file(const std::string& body) {
  constexpr std::string_view magic("\x89MCAP0\r\n", 8);
  const auto channel = [](int id, std::string_view topic) {
    return mcap_record(4, little(static_cast<std::uint64_t>(id), 2) + little(0, 2) + mcap_text(topic) +
                              mcap_text("raw") + mcap_text(""));
  };
  return std::string(magic) + mcap_record(1, mcap_text("") + mcap_text("other")) + channel(1, "/gps/in") +
         channel(2, "/gps/out") + channel(3, "/imu") + body + mcap_record(15, little(0, 4)) +
         mcap_record(2, little(0, 8) + little(0, 8) + little(0, 4)) + std::string(magic);
}

TEST_F(SmallFormatsTest, McapOfOthers) {
  const std::string messages = mcap_message(1, 1'700'000'000'000'000'000, "$GP") +
                               mcap_message(3, 1'700'000'000'000'500'000, "imu") +
                               mcap_message(2, 1'700'000'000'002'000'000, "conf");
  for (const std::string& file : {mcap_file(messages), mcap_file(mcap_chunk("", messages))}) {
    const auto made = read("mcap", file, "rx=/gps/in,tx=/gps/out");
    ASSERT_TRUE(made) << made.error().message;
    EXPECT_EQ(made->blocks, 2U);
    EXPECT_THAT(test::lines_on(made->paths), Contains(HasSubstr("conf")));
    EXPECT_THAT(test::header_line_of(made->paths), HasSubstr("2023-11-14T22:13:20.000000Z"));
  }
  const auto pressed = read("mcap", mcap_file(mcap_chunk("zstd", messages)), "rx=/gps/in,tx=/gps/out");
  ASSERT_FALSE(pressed);
  EXPECT_THAT(pressed.error().message, HasSubstr("mcap compress --compression none"));
}

TEST_F(SmallFormatsTest, McapOfTopicsThatNobodyNamedTellsWhichThereAre) {
  const std::string message = mcap_message(1, 1'700'000'000'000'000'000, "$GP");
  const auto made = read("mcap", mcap_file(message), "rx=/gps,tx=/none");
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, Errc::usage);
  EXPECT_THAT(made.error().message,
              HasSubstr("has no messages of '/gps' or '/none'; say by --device rx=TOPIC,tx=TOPIC which are "
                        "the bytes: /gps/in, /gps/out, /imu"));
}

TEST_F(SmallFormatsTest, McapRecordsThatAreLookedAtMayHaveSixteenMebibytes) {
  constexpr std::size_t most = std::size_t{16} << 20U;
  const auto with = [&](std::size_t size) {
    return read("mcap",
                mcap_file(mcap_message(1, 1'700'000'000'000'000'000, "$GP") +
                          mcap_record(15, std::string(size, '\0'))),
                "rx=/gps/in");
  };
  const auto largest = with(most);
  ASSERT_TRUE(largest) << largest.error().message;
  EXPECT_EQ(largest->blocks, 1U);
  const auto larger = with(most + 1);
  ASSERT_FALSE(larger);
  EXPECT_THAT(larger.error().message, HasSubstr("a record of 16777217 bytes, more than 16 MiB"));
}

TEST_F(SmallFormatsTest, McapCutAnywhereIsTold) {
  const std::string whole = mcap_file(mcap_message(1, 1'700'000'000'000'000'000, "$GPGGA"));
  for (std::size_t size = 8; size < whole.size(); ++size) {
    const auto made = read("mcap", whole.substr(0, size), "rx=/gps/in");
    if (!made) {
      EXPECT_NE(made.error().message, "") << size;
    } else if (size < whole.size() - 8 - 29 - 13) {
      EXPECT_FALSE(made->problems.empty() && made->guesses.empty()) << size;
    }
  }
}

TEST_F(SmallFormatsTest, Base64) {
  for (const std::string text : {"", "f", "fo", "foo", "foob", "fooba", "foobar"}) {
    const auto back = bytes_of_base64(to_base64(as_bytes(text)));
    ASSERT_TRUE(back);
    EXPECT_EQ(as_text(*back), text);
  }
  EXPECT_EQ(to_base64(as_bytes("foobar")), "Zm9vYmFy");
  EXPECT_FALSE(bytes_of_base64("Zm9"));
  EXPECT_FALSE(bytes_of_base64("Zm9?"));
}

}  // namespace
}  // namespace porttape
