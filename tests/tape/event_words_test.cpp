#include "libport/tape/event_words.hpp"

#include <array>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

namespace porttape::event_words {
namespace {

constexpr auto kKinds = std::to_array<std::string_view>({"open", "close", "device-lost", "device-back",
                                                         "half-close", "zero", "settings", "flush", "modem",
                                                         "break", "drain", "mark", "gap", "fault", "end"});

TEST(EventWords, TheKindsOfTheFormatAreKnownAndNoOthers) {
  for (const std::string_view kind : kKinds) EXPECT_TRUE(is_known_kind(kind)) << kind;
  for (const std::string_view kind : {"", "snow", "ope", "opens", "Open"})
    EXPECT_FALSE(is_known_kind(kind)) << kind;
}

TEST(EventWords, AKeyIsKnownInAHeaderAndInAKnownKind) {
  for (const std::string_view kind : {"snow", "mark", ""}) {
    for (const std::string_view key : {"t_us", "event", "carried"})
      EXPECT_TRUE(is_known_key(kind, key)) << kind << ' ' << key;
    EXPECT_FALSE(is_known_key(kind, "colour")) << kind;
  }
  for (const std::string_view key : {"format", "tapes", "text", "xxh3"}) {
    EXPECT_TRUE(is_known_key(kHeader, key)) << key;
    EXPECT_TRUE(is_known_key("mark", key)) << key;
    EXPECT_FALSE(is_known_key("snow", key)) << key;
  }
}

TEST(EventWords, TheKeysOfDigestsAreKnown) {
  for (const std::string_view key : {"xxh3_all", "events_xxh3"}) EXPECT_TRUE(is_known_key("end", key)) << key;
}

TEST(EventWords, ANumberIsTheRecordersInAHeaderAndInAKnownKind) {
  for (const std::string_view kind : {"snow", "gap", ""}) EXPECT_TRUE(is_known_number(kind, "t_us")) << kind;
  for (const std::string_view key : {"version", "bytes", "from_us", "blocks"}) {
    EXPECT_TRUE(is_known_number(kHeader, key)) << key;
    EXPECT_TRUE(is_known_number("gap", key)) << key;
    EXPECT_FALSE(is_known_number("snow", key)) << key;
  }
  for (const std::string_view key : {"text", "why", "event", "carried"}) {
    EXPECT_FALSE(is_known_number(kHeader, key)) << key;
    EXPECT_FALSE(is_known_number("gap", key)) << key;
  }
}

constexpr std::string_view kId = "0123456789abcdef00000000000000ff";
constexpr std::string_view kDigest = "0123456789abcdef";
constexpr std::string_view kMoment = "2024-05-06T07:18:39Z";
constexpr std::string_view kBoot = "0123456f-9abc-4def-8c0a-2f6f3f6f7a11";

TEST(EventWords, EachWordCountsInItsPlace) {
  struct Place {
    std::string_view kind;
    std::string_view path;
    std::initializer_list<std::string_view> words;
  };
  const std::initializer_list<std::string_view> sides = {"driver", "device"};
  const std::initializer_list<std::string_view> states = {"on", "off"};
  for (const Place& place : std::initializer_list<Place>{
           {kHeader, "format", {"porttape-events"}},
           {kHeader, "created", {kMoment, "2024-05-06T07:18:39.000010Z"}},
           {kHeader, "id", {kId}},
           {kHeader, "zero.wall", {kMoment}},
           {kHeader, "zero.boot", {kBoot}},
           {kHeader, "transport", {"stream", "datagram"}},
           {kHeader, "stamped", {"arrival", "read"}},
           {kHeader, "previous.id", {kId}},
           {kHeader, "origin.by", {"cut", "split", "merge", "recover", "redact", "convert", "shrink"}},
           {kHeader, "origin.tapes.id", {kId}},
           {"half-close", "by", sides},
           {"zero", "wall", {kMoment}},
           {"zero", "boot", {kBoot}},
           {"settings", "by", sides},
           {"settings", "parity", {"none", "even", "odd", "mark", "space"}},
           {"settings", "order", {"exact", "sampled"}},
           {"flush", "queue", {"in", "out", "both"}},
           {"modem", "line", {"dtr", "rts", "cts", "dsr", "cd", "ri"}},
           {"modem", "state", states},
           {"modem", "by", sides},
           {"break", "state", states},
           {"break", "by", sides},
           {"fault",
            "kind",
            {"drop", "corrupt", "duplicate", "delay", "stall", "truncate", "hangup", "replug", "plan",
             "more"}},
           {"fault", "dir", {"r", "w"}},
           {"end", "read.xxh3", {kDigest}},
           {"end", "write.xxh3", {kDigest}},
       }) {
    for (const std::string_view word : place.words) {
      EXPECT_TRUE(is_word(place.kind, place.path, word)) << place.kind << ' ' << place.path << ' ' << word;
      EXPECT_FALSE(is_word("mark", place.path, word)) << place.path << ' ' << word;
      EXPECT_FALSE(is_word(place.kind, "text", word)) << place.kind << ' ' << word;
    }
    EXPECT_FALSE(is_word(place.kind, place.path, "secret")) << place.kind << ' ' << place.path;
    EXPECT_FALSE(is_word(place.kind, place.path, "")) << place.kind << ' ' << place.path;
  }
}

TEST(EventWords, TheKindOfAnEventIsAWordAndThatOfAHeaderIsNone) {
  EXPECT_TRUE(is_word("mark", "event", "mark"));
  EXPECT_TRUE(is_word("snow", "event", "open"));
  EXPECT_FALSE(is_word("snow", "event", "snow"));
  EXPECT_FALSE(is_word(kHeader, "event", "mark"));
}

TEST(EventWords, AnIdIs32SmallHexadecimalDigitsAndADigest16) {
  for (const auto& [kind, path, good] :
       {std::array{kHeader, std::string_view("id"), kId},
        std::array{std::string_view("end"), std::string_view("read.xxh3"), kDigest}}) {
    std::string text(good);
    EXPECT_FALSE(is_word(kind, path, text + "0"));
    EXPECT_FALSE(is_word(kind, path, text + text));
    text.pop_back();
    EXPECT_FALSE(is_word(kind, path, text));
    for (const char other : {'g', 'F', '`', '/', ':', ' '})
      EXPECT_FALSE(is_word(kind, path, text + other)) << other;
  }
}

TEST(EventWords, AMomentHasTheFormOfAHeaders) {
  for (const std::string_view other :
       {"2024-05-06T07:18:39", "2024-05-06T07:18:39ZZ", "2024-05-06T07:18:39.00001Z", "2024-05-06 07:18:39Z",
        "2024-05-06T07:18:3:Z", "2024-05-06T07:18:3/Z", "2024-05-06T07:18:3aZ", "2024-05-06T07:18:39.00001:Z",
        "2024-05-06T07:18:39z", "2024/05-06T07:18:39Z"})
    EXPECT_FALSE(is_word(kHeader, "created", other)) << other;
  EXPECT_TRUE(is_word(kHeader, "created", "0918-27-36T45:56:67.890123Z"));
}

TEST(EventWords, ABootHasTheFormOfTheKernels) {
  const std::string good(kBoot);
  for (const char other : {'g', '`', 'A', '/', ':', '-'})
    EXPECT_FALSE(is_word("zero", "boot", good.substr(0, good.size() - 1) + other)) << other;
  std::string undivided = good;
  undivided[8] = '0';
  EXPECT_FALSE(is_word("zero", "boot", undivided));
  EXPECT_FALSE(is_word("zero", "boot", good.substr(1)));
}

}  // namespace
}  // namespace porttape::event_words
