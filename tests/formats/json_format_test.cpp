#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::imported;
using testing::HasSubstr;

class JsonFormatTest : public testing::Test {
 protected:
  test::TempDir dir;
};

TEST_F(JsonFormatTest, ReadsWhatCatPrints) {
  const auto made =
      imported(dir, "t", "json",
               R"({"t_us":0,"event":"open"})"
               "\n"
               R"({"t_us":10,"until_us":12,"dir":"r","offset":0,"length":2,"blocks":2,"hex":"4142"})"
               "\n\n"
               R"({"t_us":20,"event":"end"})"
               "\n");
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->blocks, 1U);
  EXPECT_THAT(made->guesses, testing::Contains(HasSubstr("burst")));
}

TEST_F(JsonFormatTest, AnEventIsOneWhateverItsKeys) {
  const std::vector<std::string> events{
      R"({"t_us":5,"event":"fault","kind":"corrupt","dir":"r","offset":5,"spec":"corrupt:byte=5:dir=r"})",
      R"({"t_us":6,"event":"strange","dir":"w","hex":"41","length":1})",
      R"({"t_us":7,"event":"stranger","format":"porttape-events"})"};
  std::string text;
  for (const std::string& event : events) text += event + '\n';
  const auto made = imported(dir, "t", "json", text);
  EXPECT_EQ(test::lines_of(made), events);
  EXPECT_EQ(test::exported(made->paths, "json").substr(test::header_line_of(made->paths).size() + 1), text);
}

TEST_F(JsonFormatTest, TimesThatGoBackAreToldWithTheirLines) {
  EXPECT_THAT(imported(dir, "t", "csv",
                       "seconds,kind,data\n0.5,r,41\n,more,42\n0.2,w,43\n0.6,r,44\n"
                       "0.3,event,\"{\"\"t_us\"\":0,\"\"event\"\":\"\"open\"\"}\"\n")
                  ->problems,
              testing::ElementsAre(HasSubstr("lines 4 and 6: the time goes back; ")));
}

TEST_F(JsonFormatTest, ErrorsTellTheirLine) {
  const auto error = [&](const char* format, const std::string& text) {
    const auto made = imported(dir, "t", format, text);
    return made ? "" : made.error().message;
  };
  const std::string open = R"({"t_us":0,"event":"open"})"
                           "\n";
  EXPECT_THAT(error("json", open + "{\n"), HasSubstr("evidence:2:1: "));
  EXPECT_THAT(error("json", open + R"({"t_us":0,"dir":"x","hex":""})"),
              HasSubstr("evidence:2:1: \"dir\" is"));
  EXPECT_THAT(error("json", open + R"({"t_us":0,"dir":"r","hex":"4"})"),
              HasSubstr("evidence:2:1: \"hex\" is"));
  EXPECT_THAT(error("json", open + R"({"t_us":-1,"dir":"r","hex":"41"})"), HasSubstr("evidence:2:1: "));
  EXPECT_THAT(error("json", open +
                                R"({"t_us":0,"dir":"r","hex":"41","length":2})"
                                "\n" +
                                open),
              HasSubstr("evidence:3:1: "));
  EXPECT_THAT(error("json", "hello\n"), HasSubstr("evidence:1:1: "));
  EXPECT_THAT(error("csv", "time,dir\n"), HasSubstr("evidence:1"));
  EXPECT_THAT(error("csv", "seconds,kind,data\n0,r\n"), HasSubstr("evidence:2:"));
  EXPECT_THAT(error("csv", "seconds,kind,data\n0.1,q,41\n"), HasSubstr("evidence:2:5: "));
  EXPECT_THAT(error("csv", "seconds,kind,data\n0.1,r,4\n"), HasSubstr("evidence:2:7: "));
}

}  // namespace
}  // namespace porttape
