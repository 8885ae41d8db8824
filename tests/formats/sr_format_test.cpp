#include <map>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/formats/uart_decoder.hpp"
#include "libport/formats/uart_options.hpp"
#include "libport/formats/uart_waveform.hpp"
#include "libport/formats/zip_file.hpp"
#include "tests/formats/convert_tape.hpp"
#include "tests/support/random_tape.hpp"

namespace porttape {
namespace {

using test::exported;
using test::imported;
using test::lines_of;
using test::MemoryTape;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

std::string zipped(const std::vector<std::pair<std::string, std::string>>& files) {
  NewFile file = NewFile::in_memory();
  ZipWriter zip(file);
  for (const auto& [name, text] : files) {
    if (!zip.add(name, as_bytes(text))) return "no zip";
  }
  return zip.finish() && file.finish() ? file.take() : "no zip";
}

std::string metadata(const std::string& rate, const std::string& more = "probe1=D0\n") {
  return "[global]\nsigrok version=0.5.2\n[device 1]\ncapturefile=logic-1\nunitsize=1\nsamplerate=" + rate +
         "\n" + more;
}

// A line's samples; `bit` is its channel.
std::string samples(const std::string& bytes, const LineSettings& line, std::size_t of_bit, Byte bit = 1) {
  std::string all(of_bit * 20, static_cast<char>(bit));
  for (const char c : bytes) {
    const std::uint32_t word = uart_word(static_cast<Byte>(c), line);
    for (unsigned i = 0; i < uart_bits(line); ++i)
      all.append(of_bit, static_cast<char>((word >> i & 1U) != 0 ? bit : 0));
  }
  return all.append(of_bit * 20, static_cast<char>(bit));
}

// What went each way, all blocks together.
std::map<RecordKind, std::string> bytes_on(const TapePaths& paths) {
  std::map<RecordKind, std::string> bytes;
  auto reader = TapeReader::open(paths);
  for (;;) {
    const auto next = reader->next();
    if (!next || !*next) return bytes;
    if ((*next)->event == nullptr && !(*next)->data.empty()) bytes[(*next)->kind] += as_text((*next)->data);
  }
}

class SrFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> read(const std::string& text, const std::string& device = "",
                            std::optional<unsigned> bytes_at = {}) {
    ImportOptions options;
    if (!device.empty()) options.device = device;
    options.bytes_at = bytes_at;
    return imported(dir, "back" + std::to_string(++made_), "sr", text, options);
  }
  TapePaths tape(const MemoryTape& records) {
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++made_))), records, {});
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(SrFormatTest, RandomTapesKeepTheirBytes) {
  for (unsigned seed = 0; seed < 30; ++seed) {
    std::mt19937 random(seed);
    const auto choose = [&](std::uint32_t n) {
      return n == 0 ? 0U : static_cast<std::uint32_t>(random()) % n;
    };
    MemoryTape records;
    const std::array<Parity, 5> parities = {Parity::none, Parity::even, Parity::odd, Parity::mark,
                                            Parity::space};
    const LineSettings line{
        .baud = 9600U << choose(4), .parity = parities.at(choose(5)), .stop_bits = 1 + choose(2)};
    records.event(0, event::Settings{Side::device, SeenSettings::of(line), {}});
    for (std::int64_t at = 0; at < 2'000'000; at += 1 + choose(50'000)) {
      std::string bytes;
      for (std::uint32_t i = choose(30); i > 0; --i) bytes += static_cast<char>(choose(256));
      choose(2) == 0 ? records.read(at, bytes) : records.write(at, bytes);
    }
    const TapePaths paths = tape(records);
    const std::string session = exported(paths, "sr");
    const auto back = read(session);
    ASSERT_TRUE(back) << "seed " << seed << ": " << back.error().message;
    EXPECT_EQ(bytes_on(back->paths), bytes_on(paths)) << "seed " << seed;
    EXPECT_THAT(back->problems, ElementsAre());
    EXPECT_EQ(detect_format(session, ""), find_format("sr"));
    EXPECT_EQ(exported(paths, "sr"), session);
  }
}

TEST_F(SrFormatTest, TimesAreThoseOfTheLine) {
  const auto back =
      read(exported(tape(MemoryTape()
                             .event(0, event::Settings{Side::device, {.baud = 10'000}, {}})
                             .write(1'000, "abc")
                             .read(100'000, "OK")
                             .event(200'000, signal_event({Side::device, {LineSignal::Name::brk, true}}))
                             .event(250'000, signal_event({Side::device, {LineSignal::Name::brk, false}}))
                             .write(300'000, "x")
                             .read(300'000, std::string(100, 'y'))),
                    "sr"));
  // 64 bytes of the last block had been there before; the line carries one a millisecond.
  EXPECT_THAT(lines_of(back),
              ElementsAre(HasSubstr("open"), HasSubstr("\"baud\":10000"), "w 1000 abc", "r 100000 OK",
                          HasSubstr(R"({"t_us":200000,"event":"break","state":"on","by":"device"})"),
                          HasSubstr(R"({"t_us":250000,"event":"break","state":"off","by":"device"})"),
                          "w 300000 x", AllOf(HasSubstr("r 350"), HasSubstr("yyy"))));
}

TEST_F(SrFormatTest, FarMoreBytesThanALineCarriesTakeTheirTime) {
  std::string large(UartWaveform::kMostFrames + 100, 'U');
  MemoryTape records;
  records.event(0, event::Settings{Side::device, {.baud = 12'000'000}, {}}).write(0, large).read(0, "after");
  const TapePaths paths = tape(records);
  const auto back = read(exported(paths, "sr"));
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(bytes_on(back->paths), bytes_on(paths));
}

TEST_F(SrFormatTest, ForeignSessionsNeedOptionsOrAreGuessed) {
  const LineSettings line{.baud = 19'200, .data_bits = 7, .parity = Parity::even};
  const std::string session = zipped({{"version", "2"},
                                      {"metadata", metadata("192 kHz", "probe1=CLK\nprobe2=DATA\n")},
                                      {"logic-1-1", samples("hello", line, 10, 2)},
                                      {"logic-1-2", samples("again", line, 10, 2)},
                                      {"analog-1-1-1", "left alone"}});
  const auto told = read(session, "rx=data,databits=7,parity=even", 19'200);
  ASSERT_TRUE(told) << told.error().message;
  EXPECT_THAT(told->guesses, ElementsAre());
  EXPECT_EQ(bytes_on(told->paths)[RecordKind::read], "helloagain");
  const auto guessed = read(session, "databits=7,parity=even");
  ASSERT_TRUE(guessed) << guessed.error().message;
  EXPECT_THAT(guessed->guesses, ElementsAre(HasSubstr("'CLK'"), HasSubstr("'DATA'"), HasSubstr("19200")));
  EXPECT_EQ(bytes_on(guessed->paths)[RecordKind::write], "helloagain");
  EXPECT_GT(read(session, "rx=DATA,parity=odd,databits=7")->problem_count, 0U);
}

TEST_F(SrFormatTest, InvertedAndWideSamples) {
  std::string wide;
  for (const char c : samples("inverted", {.baud = 9600}, 8))
    wide += std::string(1, '\x5a') + (c == 0 ? '\x80' : '\0');
  const auto made = read(zipped({{"version", "2"},
                                 {"metadata",
                                  "[device 1]\ncapturefile=logic-1\nunitsize=2\nsamplerate=76800\n"
                                  "probe1=A\nprobe16=B\n"},
                                 {"logic-1", wide}}),
                         "tx=B,invert", 9600);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(bytes_on(made->paths)[RecordKind::write], "inverted");
}

TEST_F(SrFormatTest, WhatIsWrongIsTold) {
  const auto error = [&](const std::string& session, const std::string& device = "") {
    const auto made = read(session, device);
    return made ? "" : made.error().message;
  };
  const auto session = [&](const std::string& text) {
    return zipped({{"version", "2"}, {"metadata", text}});
  };
  EXPECT_THAT(error("no zip at all"), HasSubstr("is no zip"));
  EXPECT_THAT(error(zipped({{"a", "b"}})), HasSubstr("no file `metadata`"));
  EXPECT_THAT(error(zipped({{"version", "3"}})), HasSubstr("version '3'"));
  EXPECT_THAT(error(zipped({{"version", "2"}, {"logic-1-1", "x"}})), HasSubstr("before the `metadata`"));
  EXPECT_THAT(error(session(metadata("0 Hz"))), HasSubstr("rate"));
  EXPECT_THAT(error(session("[device 1]\ncapturefile=x\nsamplerate=1\nunitsize=99\nprobe1=a\n")),
              HasSubstr("size"));
  EXPECT_THAT(error(session(metadata("1 MHz"))), HasSubstr("--bytes-at"));
  EXPECT_THAT(error(session(metadata("1 MHz")), "rx=D7"), HasSubstr("no channel 'D7'; there are D0"));
  EXPECT_THAT(error(session(metadata("1 MHz")), "colour=red"), HasSubstr("'colour=red' is wrong"));
  const std::string whole =
      zipped({{"version", "2"}, {"metadata", metadata("1 MHz")}, {"logic-1-1", samples("x", {}, 100)}});
  EXPECT_THAT(error(whole.substr(0, whole.size() / 2), "rx=D0"),
              AllOf(HasSubstr("at byte "), HasSubstr("damaged")));
}

TEST(UartOptionsTest, EachValueIsCheckedByItsBounds) {
  const auto line = [](const std::string& text) {
    const Result<UartOptions> options = UartOptions::parse(text);
    return options ? std::optional(options->line) : std::nullopt;
  };
  for (const unsigned bits : {5U, 6U, 7U, 8U})
    EXPECT_EQ(line("databits=" + std::to_string(bits)).value().data_bits, bits);
  for (const unsigned bits : {1U, 2U})
    EXPECT_EQ(line("stopbits=" + std::to_string(bits)).value().stop_bits, bits);
  for (const char* const wrong :
       {"databits=4", "databits=9", "databits=", "databits", "stopbits=0", "stopbits=3", "stopbits=x",
        "parity=some", "rx=", "tx", "baud=300", "invert=1"}) {
    EXPECT_FALSE(line(wrong)) << wrong;
  }
  const std::pair<const char*, Parity> parities[] = {{"none", Parity::none},
                                                     {"even", Parity::even},
                                                     {"odd", Parity::odd},
                                                     {"mark", Parity::mark},
                                                     {"space", Parity::space}};
  for (const auto& [name, parity] : parities)
    EXPECT_EQ(line(std::string("parity=") + name).value().parity, parity);
  const UartOptions all = *UartOptions::parse("rx=D0,tx=D1,databits=8,parity=even,stopbits=1,invert");
  EXPECT_EQ(all.rx, "D0");
  EXPECT_EQ(all.tx, "D1");
  EXPECT_TRUE(all.inverted);
  EXPECT_FALSE(UartOptions::parse("rx=D0")->inverted);
}

}  // namespace
}  // namespace porttape
