#include "libport/base/stranger_text.hpp"

#include <fmt/format.h>
#include <string>
#include <type_traits>

#include <gtest/gtest.h>

#include "libport/base/json_object.hpp"

namespace porttape {
namespace {

// Each place's letters are in it.
const StrangerText kText("a\x1b[31m\n<b>'\"&$(x)");

// Nothing else may print it: a new place is to be named in the header.
static_assert(!std::is_convertible_v<StrangerText, std::string>);
static_assert(!std::is_convertible_v<StrangerText, std::string_view>);
static_assert(!fmt::is_formattable<StrangerText>::value);

TEST(StrangerTextTest, ALineHasNothingThatATerminalObeys) {
  EXPECT_EQ(kText.for_line(), "a\\x1b[31m\\n<b>'\"&$(x)");
  EXPECT_EQ(kText.in_quotes(), "'a\\x1b[31m\\n<b>'\"&$(x)'");
}

TEST(StrangerTextTest, LinesCannotPassForMessagesOfTheirOwn) {
  EXPECT_EQ(StrangerText("a\nok 1\x1b").for_lines(), "a\n  ok 1\\x1b");
}

TEST(StrangerTextTest, JsonHasItAsOneString) {
  EXPECT_EQ(kText.for_json(), "\"a\\u001b[31m\\n<b>'\\\"&$(x)\"");
  EXPECT_EQ(JsonObject().add("text", kText).str(), "{\"text\":" + kText.for_json() + "}");
}

TEST(StrangerTextTest, MarkupHasItAsText) {
  EXPECT_EQ(kText.for_element(), "a\\x1b[31m\n&lt;b&gt;'&quot;&amp;$(x)");
  EXPECT_EQ(kText.for_attribute(), "a\\x1b[31m\\n&lt;b&gt;'&quot;&amp;$(x)");
}

TEST(StrangerTextTest, AShellHasItAsOneWord) {
  EXPECT_EQ(StrangerText("it's $(x)").for_shell(), R"('it'\''s $(x)')");
  EXPECT_EQ(StrangerText("plain").for_shell(), "plain");
  EXPECT_EQ(kText.for_shell(), R"($'a\033[31m\012<b>\047"&$(x)')");
  EXPECT_EQ(StrangerText("\xe2\x80\xae\\").for_shell(), R"($'\342\200\256\134')");
}

TEST(StrangerTextTest, RawIsWhatCame) {
  EXPECT_EQ(StrangerText(std::string("a\0\xff", 3)).raw(), std::string("a\0\xff", 3));
  StrangerText text("a");
  EXPECT_FALSE(text.empty());
  text.clear();
  EXPECT_TRUE(text.empty());
  EXPECT_EQ(text, StrangerText());
  EXPECT_NE(StrangerText("a"), text);
}

}  // namespace
}  // namespace porttape
