#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "libport/rules/checksum.hpp"
#include "libport/rules/frame_number.hpp"
#include "libport/rules/frame_place.hpp"
#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

using namespace std::string_literals;

TEST(FramePlaceTest, APositionIsCountedFromTheBeginningOrTheEnd) {
  EXPECT_EQ(position_in(4, 0), 0U);
  EXPECT_EQ(position_in(4, 4), 4U);
  EXPECT_EQ(position_in(4, 5), std::nullopt);
  EXPECT_EQ(position_in(4, -1), 3U);
  EXPECT_EQ(position_in(4, -4), 0U);
  EXPECT_EQ(position_in(4, -5), std::nullopt);
}

std::optional<FrameSpan> located(const Place& place, std::string_view frame,
                                 const FrameFormat* format = nullptr) {
  const re2::RE2 capture(re2::StringPiece(place.capture.data(), place.capture.size()),
                         rule_expression_options());
  return locate(place, place.capture.empty() ? nullptr : &capture, format, as_bytes(frame));
}

TEST(FramePlaceTest, BytesAreWithinTheFrameOrNowhere) {
  EXPECT_EQ(located({.at = 1}, "abcd"), (FrameSpan{1, 4}));
  EXPECT_EQ(located({.at = 4}, "abcd"), (FrameSpan{4, 4}));
  EXPECT_EQ(located({.at = 5}, "abcd"), std::nullopt);
  EXPECT_EQ(located({.at = 1, .size = 3}, "abcd"), (FrameSpan{1, 4}));
  EXPECT_EQ(located({.at = 1, .size = 4}, "abcd"), std::nullopt);
  EXPECT_EQ(located({.at = -3, .size = 2}, "abcd"), (FrameSpan{1, 3}));
  EXPECT_EQ(located({.at = 1, .to = -1}, "abcd"), (FrameSpan{1, 3}));
  EXPECT_EQ(located({.at = 2, .to = 2}, "abcd"), (FrameSpan{2, 2}));
  EXPECT_EQ(located({.at = 3, .to = -2}, "abcd"), std::nullopt);
  EXPECT_EQ(located({.at = 0, .to = 5}, "abcd"), std::nullopt);
}

TEST(FramePlaceTest, AColumnIsBetweenSeparators) {
  const auto column = [](int number, std::string_view frame, const std::string& separator = ",") {
    return located({.by = Place::By::column, .column = number, .separator = separator}, frame);
  };
  EXPECT_EQ(column(0, "a,bc,"), (FrameSpan{0, 1}));
  EXPECT_EQ(column(1, "a,bc,"), (FrameSpan{2, 4}));
  EXPECT_EQ(column(2, "a,bc,"), (FrameSpan{5, 5}));
  EXPECT_EQ(column(3, "a,bc,"), std::nullopt);
  EXPECT_EQ(column(1, "a--bc--d", "--"), (FrameSpan{3, 5}));
  EXPECT_EQ(column(0, ""), (FrameSpan{0, 0}));
}

TEST(FramePlaceTest, TheLastColumnEndsBeforeTheChecksumAndTheEnd) {
  const Place last{.by = Place::By::column, .column = 1};
  FrameFormat format{.end = {'\r', '\n'}, .trailer = 1};
  EXPECT_EQ(located(last, "a,bc*27\r\n+", &format), (FrameSpan{2, 7}));
  format.checksum = ChecksumField{.kind = "XOR", .at = -5, .hex = true};
  EXPECT_EQ(located(last, "a,bc*27\r\n+", &format), (FrameSpan{2, 5}));
  format.checksum->to = -6;
  EXPECT_EQ(located(last, "a,bc*27\r\n+", &format), (FrameSpan{2, 4}));
  format.checksum->to = 3;  // from the beginning it says nothing of where columns end
  EXPECT_EQ(located(last, "a,bc*27\r\n+", &format), (FrameSpan{2, 7}));
  format.checksum->to = -11;  // outside
  EXPECT_EQ(located(last, "a,bc*27\r\n+", &format), (FrameSpan{2, 7}));
  EXPECT_EQ(located(last, "a,", &format), std::nullopt) << "shorter than what ends it";
  format = {.kind = FrameFormat::Kind::fixed, .end = {'x'}, .size = 4};
  EXPECT_EQ(located(last, "a,bc", &format), (FrameSpan{2, 4}));
}

TEST(FramePlaceTest, ACaptureIsItsGroupsFirstMatch) {
  const auto capture = [](const std::string& expression, std::string_view frame) {
    return located({.by = Place::By::capture, .capture = expression}, frame);
  };
  EXPECT_EQ(capture("=(\\w+)", "a=bc;d=e"), (FrameSpan{2, 4}));
  EXPECT_EQ(capture("=(\\w+)", "abc"), std::nullopt);
  EXPECT_EQ(capture("a|(b)", "ab"), std::nullopt) << "the group is not in the match";
  EXPECT_EQ(capture("a.(.)", "a\n\xff"s), (FrameSpan{2, 3})) << "a dot is any byte";
  EXPECT_EQ(capture("a()b", "ab"), (FrameSpan{1, 1}));
  EXPECT_EQ(capture("", "ab"), std::nullopt);
}

std::optional<std::uint64_t> whole(NumberType type, std::string_view field,
                                   ByteOrder order = ByteOrder::big) {
  return whole_number_in({.type = type, .order = order}, as_bytes(field));
}
std::optional<double> real(NumberType type, std::string_view field) {
  return real_number({.type = type}, as_bytes(field));
}

TEST(FrameNumberTest, OfTextIsItsDigitsWithSpacesAroundThem) {
  EXPECT_EQ(whole(NumberType::decimal, "  042 "), 42U);
  EXPECT_EQ(whole(NumberType::hex, " fF"), 255U);
  for (const char* const field :
       {"", "  ", "4 2", "42x", "?42", "42?", "!42", "\t42", "-1", "18446744073709551616"})
    EXPECT_EQ(whole(NumberType::decimal, field), std::nullopt) << field;
  EXPECT_EQ(whole(NumberType::hex, "fg"), std::nullopt);
  EXPECT_EQ(real(NumberType::decimal, " -12.50 "), -12.5);
  EXPECT_EQ(real(NumberType::decimal, "1e3"), 1000.0);
  EXPECT_EQ(real(NumberType::decimal, "1.5V"), std::nullopt);
  EXPECT_EQ(real(NumberType::hex, "10"), 16.0);
}

TEST(FrameNumberTest, OfBytesIsInTheirOrder) {
  EXPECT_EQ(whole(NumberType::unsigned_, "\x01\x02\x03"), 0x010203U);
  EXPECT_EQ(whole(NumberType::unsigned_, "\x01\x02\x03", ByteOrder::little), 0x030201U);
  EXPECT_EQ(whole(NumberType::unsigned_, std::string(8, '\xff')), ~std::uint64_t{0});
  EXPECT_EQ(whole(NumberType::unsigned_, std::string(9, '\0')), std::nullopt);
  EXPECT_EQ(whole(NumberType::unsigned_, ""), std::nullopt);
  EXPECT_EQ(real(NumberType::signed_, "\xff"), -1.0);
  EXPECT_EQ(real(NumberType::unsigned_, "\xff"), 255.0);
  EXPECT_EQ(real(NumberType::signed_, "\x80\x00"s), -32768.0);
  EXPECT_EQ(real(NumberType::signed_, "\x7f\xff"), 32767.0);
  EXPECT_EQ(real(NumberType::signed_, std::string(8, '\xff')), -1.0);
  EXPECT_EQ(real(NumberType::signed_, ""), std::nullopt);
}

TEST(FrameNumberTest, ACounterBeginsAgainWhereItsFieldOrItsModuloEnds) {
  const auto on = [](const Rule& rule, std::size_t size, std::uint64_t value, std::int64_t more) {
    return counted_on(rule, size, value, static_cast<std::uint64_t>(more));
  };
  const Rule bytes;
  EXPECT_EQ(on(bytes, 1, 250, 5), 255U);
  EXPECT_EQ(on(bytes, 1, 250, 6), 0U);
  EXPECT_EQ(on(bytes, 1, 0, -1), 255U);
  EXPECT_EQ(on(bytes, 1, 5, -256), 5U);
  EXPECT_EQ(on(bytes, 2, 65535, 2), 1U);
  EXPECT_EQ(on(bytes, 7, (std::uint64_t{1} << 56) - 1, 1), 0U);
  EXPECT_EQ(on(bytes, 8, ~std::uint64_t{0}, 2), 1U);
  const Rule decimal{.type = NumberType::decimal};
  EXPECT_EQ(on(decimal, 2, 98, 1), 99U);
  EXPECT_EQ(on(decimal, 2, 98, 2), 0U);
  EXPECT_EQ(on(decimal, 19, 9'999'999'999'999'999'999U, 1), 0U);
  EXPECT_EQ(on(decimal, 20, 9'999'999'999'999'999'999U, 1), 10'000'000'000'000'000'000U);
  const Rule hex{.type = NumberType::hex};
  EXPECT_EQ(on(hex, 1, 15, 1), 0U);
  EXPECT_EQ(on(hex, 2, 15, 1), 16U);
  const Rule modulo{.counter = {10}};
  EXPECT_EQ(on(modulo, 1, 8, 1), 9U);
  EXPECT_EQ(on(modulo, 1, 8, 2), 0U);
  EXPECT_EQ(on(modulo, 1, 3, -4), 9U);
  EXPECT_EQ(on(modulo, 1, 3, -10), 3U);
  EXPECT_EQ(on(modulo, 1, 23, 1), 4U);
  const Rule grows{.type = NumberType::decimal, .length = Rule::Length{1, 9}};
  EXPECT_EQ(on(grows, 1, 9, 1), 10U);
}

std::string expected(const ChecksumField& field, std::string_view frame, std::string_view like = {}) {
  const FrameChecksum checksum(field, *find_checksum(field.kind));
  const auto bytes = checksum.expected(as_bytes(frame), as_bytes(like));
  return bytes ? std::string(as_text(*bytes)) : "nothing";
}

TEST(FrameChecksumTest, IsInTheOrderOfItsField) {
  const std::string digits = "123456789";
  EXPECT_EQ(expected({.kind = "CRC-16/MODBUS", .at = -2}, digits + "??"), "\x4b\x37");
  EXPECT_EQ(expected({.kind = "CRC-16/MODBUS", .at = -2, .order = ByteOrder::little}, digits + "??"),
            "\x37\x4b");
  EXPECT_EQ(expected({.kind = "CRC-16/MODBUS", .at = 0, .from = 2}, "??" + digits), "nothing")
      << "it would be of what stands before its own first byte";
  EXPECT_EQ(expected({.kind = "CRC-16/MODBUS", .at = 0, .from = 2, .to = 11}, "??" + digits), "\x4b\x37");
  EXPECT_EQ(expected({.kind = "CRC-16/MODBUS", .at = -1}, digits + "??"), "nothing") << "its end is outside";
}

TEST(FrameChecksumTest, DigitsAreInTheCaseOfThoseThatStandThere) {
  const ChecksumField field{.kind = "XOR", .at = 1, .from = 0, .to = 1, .hex = true};
  EXPECT_EQ(expected(field, "\x4bzz"), "4b");
  EXPECT_EQ(expected(field, "\x4bZZ"), "4B");
  EXPECT_EQ(expected(field,
                     "\x4b"
                     "12"),
            "4B");
  EXPECT_EQ(expected(field, "\x4bZZ", "1a"), "4b");
  EXPECT_EQ(expected(field, "\x4bzz", "1A"), "4B");
  EXPECT_EQ(expected(field, "\x4bzz", "12"), "4b") << "no letters to be like";
  const ChecksumField of_hex{.kind = "XOR", .at = 4, .from = 0, .hex = true, .of_hex = true};
  EXPECT_EQ(expected(of_hex, "0F3000"), "3F");
  EXPECT_EQ(expected(of_hex, "0G3000"), "nothing");
  EXPECT_EQ(size_of(of_hex, *find_checksum("XOR")), 2U);
  EXPECT_EQ(size_of({.kind = "CRC-16/MODBUS"}, *find_checksum("CRC-16/MODBUS")), 2U);
}

TEST(FrameChecksumTest, OfMavlinkIsBehindThePayloadWithTheMessagesExtra) {
  const ChecksumField field{
      .kind = "CRC-16/MCRF4XX", .from = 1, .order = ByteOrder::little, .mavlink_extra = true};
  const FrameChecksum checksum(field, *find_checksum(field.kind));
  const auto place = [&](const std::string& frame) {
    const auto span = checksum.place(as_bytes(frame));
    return span ? std::to_string(span->begin) + " " + std::to_string(span->end) : "nothing";
  };
  EXPECT_EQ(place("\xfe\x01" + std::string(8, '\0')), "7 9");
  EXPECT_EQ(place("\xfd\x01" + std::string(11, '\0')), "11 13");
  EXPECT_EQ(place("\xfd\x01" + std::string(10, '\0')), "nothing");
  EXPECT_EQ(place("\xfe"), "nothing");
  EXPECT_EQ(checksum.name(), find_checksum(field.kind)->name);
  const auto told = [&](const std::string& frame) { return checksum.expected(as_bytes(frame)).has_value(); };
  const std::string tail(8, '\0');
  EXPECT_TRUE(told("\xfe\x00\x00\x00\x00\x00"s + tail));
  EXPECT_FALSE(told("\xfe\x00\x00\x00\x00\x03"s + tail)) << "message 3 is unknown";
  EXPECT_TRUE(told("\xfd\x00\x00\x00\x00\x00\x00\x4c\x01\x00"s + tail)) << "message 332";
  EXPECT_FALSE(told("\xfd\x00\x00\x00\x00\x00\x00\x4c\x00\x01"s + tail));
  EXPECT_FALSE(told("\xfd\x00\x00\x00\x00\x00\x00\x03\x00\x00"s + tail));
  EXPECT_FALSE(told("\xff\x00\x00\x00\x00\x00\x00\x00\x00\x00"s + tail)) << "no frame of either version";
  EXPECT_EQ(mavlink_crc_extra(0), Byte{50});
  EXPECT_EQ(mavlink_crc_extra(4), Byte{237});
  EXPECT_EQ(mavlink_crc_extra(3), std::nullopt);
  EXPECT_EQ(mavlink_crc_extra(0xffffff), std::nullopt);
}

}  // namespace
}  // namespace porttape
