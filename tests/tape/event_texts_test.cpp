#include "libport/tape/event_texts.hpp"

#include <string>
#include <string_view>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class EventTexts : public testing::Test {
 protected:
  // Each text becomes "X"; `given` has "key=text" of each, `fixed` what was shown.
  std::string changed(std::string_view line) {
    given.clear();
    fixed.clear();
    return change_texts(
        line,
        [this](std::string_view key, std::string_view text) {
          given.push_back(std::string(key) + "=" + std::string(text));
          return std::string("X");
        },
        [this](FixedText what, std::string_view key, std::string_view text) {
          const char* const kind = what == FixedText::number ? "number "
                                   : what == FixedText::key  ? "key "
                                                             : "kind ";
          fixed.push_back(kind + std::string(key) + "=" + std::string(text));
        });
  }

  std::vector<std::string> given;
  std::vector<std::string> fixed;
};

TEST_F(EventTexts, WhatSomebodySaidIsChangedAndWordsOfTheFormatStay) {
  EXPECT_EQ(changed(R"({"t_us":7,"event":"mark","text":"secret"})"),
            R"({"t_us":7,"event":"mark","text":"X"})");
  EXPECT_THAT(given, ElementsAre("text=secret"));
  EXPECT_THAT(fixed, IsEmpty());
  EXPECT_EQ(changed(R"({"t_us":7,"event":"modem","line":"dtr","state":"on","by":"me"})"),
            R"({"t_us":7,"event":"modem","line":"dtr","state":"on","by":"X"})");
}

TEST_F(EventTexts, OfAHeaderTheKeyIsGivenWithThoseItStandsIn) {
  EXPECT_EQ(
      changed(
          R"({"format":"porttape-events","version":1,"device":"d","identity":{"serial":"s","interface":2},)"
          R"("origin":{"by":"cut","tapes":[{"name":"a"},{"name":"b"},"c"],"from_us":5}})"),
      R"({"format":"porttape-events","version":1,"device":"X","identity":{"serial":"X","interface":2},)"
      R"("origin":{"by":"cut","tapes":[{"name":"X"},{"name":"X"},"X"],"from_us":5}})");
  EXPECT_THAT(given, ElementsAre("device=d", "identity.serial=s", "origin.tapes.name=a",
                                 "origin.tapes.name=b", "origin.tapes=c"));
  EXPECT_THAT(fixed, IsEmpty());
}

TEST_F(EventTexts, ALineInWhichNothingChangesStaysAsItIs) {
  for (const std::string_view line :
       {R"({ "t_us" : 7, "event" : "open" })", R"({ "t_us":7, "event":"mark", "text":"X" })",
        R"({ "t_us":7, "event":"snow", "depth":[1, "X"] })", "no line", "[\"x\"]", ""})
    EXPECT_EQ(changed(line), line);
}

TEST_F(EventTexts, OneChangeAmongOthersIsEnough) {
  EXPECT_EQ(changed(R"({"event":"snow","a":"secret","b":"X"})"), R"({"event":"snow","a":"X","b":"X"})");
  EXPECT_EQ(changed(R"({"event":"snow","a":["secret","X"]})"), R"({"event":"snow","a":["X","X"]})");
  EXPECT_EQ(changed(R"({"event":"snow","a":["X","secret"]})"), R"({"event":"snow","a":["X","X"]})");
}

TEST_F(EventTexts, WhatCannotBeChangedIsShown) {
  EXPECT_EQ(changed(R"({"t_us":7,"event":"snow","depth":{"cm":[5,6.5]},"bytes":3,"carried":true})"),
            R"({"t_us":7,"event":"snow","depth":{"cm":[5,6.5]},"bytes":3,"carried":true})");
  EXPECT_THAT(fixed, ElementsAre("kind event=snow", "key =depth", "key depth=cm", "number depth.cm=5",
                                 "number depth.cm=6.5E0", "key =bytes", "number bytes=3"));
  EXPECT_THAT(given, IsEmpty());
  changed(R"({"t_us":7,"event":"gap","bytes":3,"why":4,"lost":5})");
  EXPECT_THAT(fixed, ElementsAre("number why=4", "key =lost", "number lost=5"));
}

TEST_F(EventTexts, ALineWithoutAKindIsAHeaders) {
  changed(R"({"event":5,"created":"2024-05-06T07:08:09Z"})");
  EXPECT_THAT(given, IsEmpty());
  EXPECT_THAT(fixed, ElementsAre("number event=5"));
  changed(R"({"event":"","created":"2024-05-06T07:08:09Z"})");
  EXPECT_THAT(given, ElementsAre("event="));
}

TEST_F(EventTexts, NobodyNeedsToLook) {
  const auto change = [](std::string_view, std::string_view) { return std::string("X"); };
  EXPECT_EQ(change_texts(R"({"event":"snow","depth":5,"a":"secret"})", change),
            R"({"event":"snow","depth":5,"a":"X"})");
}

TEST_F(EventTexts, WhatIsPutInIsUtf8) {
  const auto change = [](std::string_view, std::string_view) { return std::string("\xff"); };
  EXPECT_EQ(change_texts(R"({"event":"mark","text":"a"})", change),
            "{\"event\":\"mark\",\"text\":\"\xEF\xBF\xBD\"}");
}

std::vector<std::string> texts_in(std::string_view line) {
  std::vector<std::string> texts;
  each_text(line, [&](std::string_view text) { texts.emplace_back(text); });
  return texts;
}

TEST_F(EventTexts, EachStringIsVisitedAndNoKey) {
  EXPECT_THAT(
      texts_in(R"({"t_us":7,"event":"snow","deep":[1,"a",["b",{"key":"c"}]],"d":{"e":"f"},"g":true})"),
      ElementsAre("snow", "a", "b", "c", "f"));
  EXPECT_THAT(texts_in("no line"), IsEmpty());
}

TEST_F(EventTexts, WhatTellsOfTheMachineGoes) {
  EXPECT_EQ(without_identity(R"({"format":"x", "host":"bench"})"), R"({"format":"x"})");
  EXPECT_EQ(without_identity(R"({"format":"x", "identity":{"path":"p"}})"), R"({"format":"x"})");
  EXPECT_EQ(without_identity(R"({"zero":{"wall":"w", "boot":"b"}})"), R"({"zero":{"wall":"w"}})");
  EXPECT_EQ(without_identity(R"({"event":"zero", "boot":"b"})"), R"({"event":"zero"})");
  EXPECT_EQ(without_identity(R"({"host":1,"identity":2,"zero":{"boot":3},"boot":4})"), R"({"zero":{}})");
  for (const std::string_view line :
       {R"({ "zero" : 5 })", R"({ "zero" : {"wall":"w"} })", R"({ "hosts" : 1 })", "no line", "[1]"})
    EXPECT_EQ(without_identity(line), line);
}

}  // namespace
}  // namespace porttape
