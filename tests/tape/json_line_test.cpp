#include "libport/tape/json_line.hpp"

#include <string_view>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using namespace std::string_view_literals;

TEST(JsonLine, IsAnObjectWhateverItsBytes) {
  EXPECT_TRUE(parse_json_line(R"({"a":1})").is_object());
  EXPECT_TRUE(parse_json_line("{\"a\":\"\xff\"}").is_object());
  for (const std::string_view other : {""sv, "x"sv, "1"sv, "[1]"sv, "{\"a\":1"sv, "{\"a\":1}x"sv})
    EXPECT_TRUE(parse_json_line(other).is_null()) << other;
}

TEST(JsonLine, GoesOnWhereMoreThanWhiteSpaceIsBehindItsValue) {
  EXPECT_TRUE(goes_on_behind_object(R"({"a":1}{"b":2})"));
  EXPECT_TRUE(goes_on_behind_object(R"({"a":1} x)"));
  EXPECT_TRUE(goes_on_behind_object("{\"a\":\"\xff\"}x")) << "bytes outside of UTF-8 are no matter";
}

TEST(JsonLine, DoesNotGoOnBehindWhiteSpaceOrTheZerosOfACrash) {
  for (const std::string_view text : {"{\"a\":1}"sv, "{\"a\":1}  "sv, "{\"a\":1}\0\0"sv, "{\"a\":1}\0x"sv})
    EXPECT_FALSE(goes_on_behind_object(text)) << text;
}

TEST(JsonLine, WhatIsNoWholeValueDoesNotGoOn) {
  for (const std::string_view text : {""sv, "{"sv, "{\"a\":"sv, "x{}"sv, "{\"a\"}x"sv})
    EXPECT_FALSE(goes_on_behind_object(text)) << text;
}

}  // namespace
}  // namespace porttape
