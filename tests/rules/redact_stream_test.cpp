#include "libport/rules/redact_stream.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <random>
#include <string>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/rules_reader.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using Of = RedactStream::Of;

constexpr Filler::Key kKey = {0x0706050403020100, 0x0f0e0d0c0b0a0908};

RedactBook book_of(const std::string& text, Filler::Key key = kKey) {
  const Result<RuleSet> rules = read_rules(text, "my.rules");
  EXPECT_TRUE(rules) << rules.error().message;
  return {rules ? *rules : RuleSet(), key};
}

struct Redacted {
  std::string text;
  std::vector<Redaction> redactions;
  std::string error;
  friend bool operator==(const Redacted&, const Redacted&) = default;
};

Redacted redact(const RedactBook& book, std::string_view text, Of of = Of::reads, std::size_t cut = 1 << 20) {
  RedactStream stream(book, of);
  Redacted all;
  const auto take = [&](const Result<void>& done) {
    if (!done && all.error.empty()) all.error = done.error().message;
    const RedactStream::Ready ready = stream.take();
    all.text += as_text(ready.bytes);
    all.redactions.insert(all.redactions.end(), ready.redactions.begin(), ready.redactions.end());
  };
  for (; !text.empty(); text.remove_prefix(std::min(cut, text.size())))
    take(stream.add(as_bytes(text.substr(0, cut))));
  take(stream.finish());
  return all;
}

std::string sip_text(std::size_t size) {
  Bytes data;
  for (std::size_t i = 0; i < size; ++i) data.push_back(static_cast<Byte>(i));
  const std::uint64_t hash = sip_hash(kKey, data);
  return to_hex(ByteView(reinterpret_cast<const Byte*>(&hash), sizeof hash));
}

// The vectors that come with SipHash's description.
TEST(FillerTest, SipHashIsTheKnownOne) {
  EXPECT_EQ(sip_text(0), "310e0edd47db6f72");
  EXPECT_EQ(sip_text(8),
            "62"
            "24939a79f5f593");
  EXPECT_EQ(sip_text(15), "e545be4961ca29a1");
}

TEST(FillerTest, LooksLikeTheSecretAndIsAnother) {
  const Filler filler(kKey, {});
  const auto fill = [&](FillerKind kind, std::string_view secret, bool text = false) {
    RedactRule rule;
    rule.filler = kind;
    rule.with = {'x', 'y'};
    return std::string(as_text(filler.fill(rule, as_bytes(secret), text)));
  };
  EXPECT_THAT(fill(FillerKind::like, "A-1234.5 b"), testing::MatchesRegex("[A-Z]-[0-9]+\\.[0-9] [a-z]"));
  EXPECT_THAT(fill(FillerKind::like, "!?#"), testing::MatchesRegex("[A-Z]+"));
  EXPECT_THAT(fill(FillerKind::digits, "secret"), testing::MatchesRegex("[0-9]+"));
  EXPECT_THAT(fill(FillerKind::hex, "12ab"), testing::MatchesRegex("[0-9a-f]+"));
  EXPECT_THAT(fill(FillerKind::letters, "12ab"), testing::MatchesRegex("[a-z]+"));
  EXPECT_EQ(fill(FillerKind::constant, "12345"), "xyxyx");
  EXPECT_THAT(fill(FillerKind::bytes, std::string(4, '\1'), true), testing::MatchesRegex("[A-Z]+"));
  for (char digit = '0'; digit <= '9'; ++digit)
    EXPECT_NE(fill(FillerKind::like, std::string(1, digit)), std::string(1, digit));
  EXPECT_EQ(fill(FillerKind::like, "same"), fill(FillerKind::like, "same"));
  EXPECT_NE(as_text(Filler({1, 2}, {}).fill({}, as_bytes("same secret"))),
            fill(FillerKind::like, "same secret"));
}

TEST(RedactStreamTest, TheEndOfAnExpressionIsTheStreamsHoweverTheStreamIsCut) {
  const RedactBook book = book_of("[[redact]]\nname='r'\npattern='P=\\w$'\nlongest=3\n");
  constexpr std::size_t kWork = std::size_t{32} * 1024;  // bytes after which a part is searched
  for (std::size_t before = kWork - 6; before <= kWork; ++before) {
    const std::string text = std::string(before, '.') + "P=a";
    EXPECT_EQ(redact(book, text + "!", Of::reads, kWork).text, text + "!");
    EXPECT_NE(redact(book, text, Of::reads, kWork).text, text);
  }
}

TEST(RedactStreamTest, TheSameSecretGetsTheSameFillerInBothDirections) {
  const RedactBook book = book_of("[[redact]]\nname='serial'\npattern='SN[:=](\\w+)'\n");
  const Redacted read = redact(book, "SN:AB12;SN:CD34;SN:AB12");
  const Redacted write = redact(book, "SN=AB12", Of::writes);
  EXPECT_THAT(read.redactions, ElementsAre(Redaction{3, 4, 0}, Redaction{11, 4, 0}, Redaction{19, 4, 0}));
  EXPECT_EQ(read.text.substr(3, 4), read.text.substr(19));
  EXPECT_NE(read.text.substr(3, 4), read.text.substr(11, 4));
  EXPECT_EQ(read.text.substr(3, 4), write.text.substr(3));
  EXPECT_EQ(read.text.find("AB12"), std::string::npos);
  EXPECT_EQ(read.text.size(), 23U);
}

TEST(RedactStreamTest, ARuleOfOneDirectionLeavesTheOther) {
  const RedactBook book = book_of("[[redact]]\nname='word'\ntext='open'\ndir='w'\n");
  EXPECT_EQ(redact(book, "an open").text, "an open");
  EXPECT_NE(redact(book, "an open", Of::writes).text, "an open");
}

TEST(RedactStreamTest, ChecksumsFollowWhereTheyWereRight) {
  const RedactBook book = book_of(
      "[[frame]]\nprotocol='nmea'\n[[redact]]\nname='latitude'\nwhen='^.GPGLL'\ncolumn=1\nwith='0000.000'\n");
  const Redacted good = redact(book, "junk$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n");
  EXPECT_EQ(good.text, "junk$GPGLL,0000.000,N,00146.110,E,142451,A*2E\r\n");
  EXPECT_THAT(good.redactions, ElementsAre(Redaction{11, 8, 0}, Redaction{44, 1, Redaction::kFollows}));
  RedactStream stream(book, Of::reads);
  ASSERT_TRUE(stream.add(as_bytes("$GPGLL,5057.970,N,00146.110,E,142451,A*28\r\n")));
  ASSERT_TRUE(stream.finish());
  EXPECT_EQ(as_text(stream.take().bytes), "$GPGLL,0000.000,N,00146.110,E,142451,A*28\r\n");
  EXPECT_EQ(stream.wrong_checksums(), 1U);
}

TEST(RedactStreamTest, WhatAPatternFindsInAFrameIsMendedToo) {
  const RedactBook book =
      book_of("[[frame]]\nprotocol='nmea'\n[[redact]]\nname='it'\ntext='142451'\nwith='0'\n");
  EXPECT_EQ(redact(book, "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n").text,
            "$GPGLL,5057.970,N,00146.110,E,000000,A*20\r\n");
}

TEST(RedactStreamTest, NothingOfOverlappingSecretsIsLeft) {
  const RedactBook book =
      book_of("[[redact]]\nname='a'\ntext='abcd'\nwith='1'\n[[redact]]\nname='b'\ntext='cdef'\nwith='2'\n");
  EXPECT_EQ(redact(book, "-abcdef-").text, "-111122-");
}

TEST(RedactStreamTest, RangesAreOfTheStream) {
  const RedactBook book = book_of("[[redact]]\nname='a'\ndir='r'\noffset=3\nsize=5000\nwith='#'\n");
  const std::string text(6000, 'a');
  for (const std::size_t cut : {1U, 1000U, 6000U}) {
    EXPECT_EQ(redact(book, text, Of::reads, cut).text,
              "aaa" + std::string(5000, '#') + std::string(997, 'a'));
  }
  EXPECT_EQ(redact(book, "abcdef").text, "abc###");
  EXPECT_EQ(redact(book, text, Of::writes).text, text);
}

TEST(RedactStreamTest, AMatchThatMayGoOnIsAnError) {
  const RedactBook book = book_of("[[redact]]\nname='long'\npattern='=(\\w+)'\nlongest=8\n");
  EXPECT_EQ(redact(book, "=1234567.").error, "");
  EXPECT_THAT(redact(book, "ab=12345678.").error, HasSubstr("a match at byte 2 may go on beyond 8 bytes"));
}

// What ends a secret may stand far behind what may be as long as the rule says.
TEST(RedactStreamTest, AMatchThatIsTooLongIsAnErrorWhereverItEnds) {
  const RedactBook book = book_of("[[redact]]\nname='key'\npattern='KEY<([^>]*)>'\nlongest=20\n");
  EXPECT_EQ(redact(book, "KEY<" + std::string(15, 'S') + ">").error, "");
  for (const std::size_t size : {16U, 17U, 1100U, 20'000U, 40'000U, 65'000U}) {
    for (const std::size_t before : {0U, 5U, 32'760U, 200'000U}) {
      const std::string text = "KEY<abc>" + std::string(before, '-') + "KEY<" + std::string(size, 'S') + ">" +
                               std::string(100, '-');
      for (const std::size_t cut : {std::size_t{4096}, std::size_t{100'000}, text.size()}) {
        EXPECT_THAT(redact(book, text, Of::reads, cut).error,
                    HasSubstr(fmt::format("a match at byte {} may go on beyond 20 bytes", 8 + before)))
            << size << ' ' << before << ' ' << cut;
      }
    }
  }
  const std::string open = "KEY<" + std::string(70'000, 'S');
  EXPECT_EQ(redact(book, open).text, open) << "no end at all is no match";
}

TEST(RedactStreamTest, AMatchThatMayGoOnIsNamedByItsPlaceInTheWholeStream) {
  const RedactBook book = book_of("[[redact]]\nname='long'\npattern='=(\\w+)'\nlongest=8\n");
  const std::string text = std::string(100'000, '-') + "=12345678.";
  EXPECT_THAT(redact(book, text, Of::reads, 1000).error,
              HasSubstr("a match at byte 100000 may go on beyond 8 bytes"));
}

TEST(RedactStreamTest, WhereTheGroupOfAPatternIsNotPartOfAMatchAllOfItIsTheSecret) {
  const RedactBook book = book_of("[[redact]]\nname='x'\npattern='x(y)?'\nwith='*'\n");
  EXPECT_EQ(redact(book, "x-xy-y").text, "*-x*-y");
}

TEST(RedactStreamTest, AnEmptyMatchHidesNothing) {
  const RedactBook book = book_of("[[redact]]\nname='a'\npattern='a*'\nwith='*'\n");
  EXPECT_EQ(redact(book, "baab").text, "b**b");
}

TEST(RedactStreamTest, ExpressionsSeeWhatStandsAround) {
  const RedactBook book = book_of("[[redact]]\nname='word'\npattern='\\bpin\\b'\nwith='-'\n");
  for (std::size_t cut = 1; cut < 20; ++cut)
    EXPECT_EQ(redact(book, "pin spin pins pin", Of::reads, cut).text, "--- spin pins ---") << cut;
  const RedactBook first = book_of("[[redact]]\nname='first'\npattern='^a|z$'\nwith='-'\n");
  const std::string long_text = "a" + std::string(100'000, 'a') + "z" + std::string(100'000, 'z');
  const std::string expected = "-" + std::string(100'000, 'a') + "z" + std::string(99'999, 'z') + "-";
  for (const std::size_t cut : {7U, 4096U, 1U << 20})
    EXPECT_EQ(redact(first, long_text, Of::reads, cut).text, expected);
}

TEST(FillerTest, InATextOnlyAsciiIsPutIn) {
  const Filler filler(kKey, {});
  const auto fill = [&](FillerKind kind, std::string_view secret, const Bytes& with = {}) {
    RedactRule rule;
    rule.filler = kind;
    rule.with = with;
    return std::string(as_text(filler.fill(rule, as_bytes(secret), true)));
  };
  EXPECT_THAT(fill(FillerKind::digits, "secret"), testing::MatchesRegex("[0-9]+"));
  EXPECT_THAT(fill(FillerKind::hex, "SECRET"), testing::MatchesRegex("[0-9A-F]+"));
  EXPECT_THAT(fill(FillerKind::like, "Ab1 "), testing::MatchesRegex("[A-Z][a-z][0-9] "));
  EXPECT_THAT(fill(FillerKind::like, "A\x80"), testing::MatchesRegex("[A-Z]+"));
  EXPECT_EQ(fill(FillerKind::constant, "abc", {' ', '~'}), " ~ ");
  for (const Byte byte : {Byte{0x1f}, Byte{0x7f}})
    EXPECT_THAT(fill(FillerKind::constant, "abc", {'a', byte}), testing::MatchesRegex("[a-z]+"));
  RedactRule rule;
  rule.filler = FillerKind::constant;
  rule.with = {0x1f};
  EXPECT_EQ(filler.fill(rule, as_bytes("ab")), (Bytes{0x1f, 0x1f}));
}

TEST(FillerTest, OfDelimitersNoneComesIntoBeing) {
  std::vector<FrameFormat> formats(2);
  for (int byte = 0; byte < 253; ++byte) formats[0].start.push_back(static_cast<Byte>(byte));
  formats[1].end = {253};
  RedactRule rule;
  rule.filler = FillerKind::bytes;
  const Filler two(kKey, formats);
  for (int secret = 0; secret < 256; ++secret) {
    const Bytes filled = two.fill(rule, Bytes{static_cast<Byte>(secret)});
    EXPECT_GE(filled[0], 254);
    EXPECT_NE(filled[0], secret);
  }
  formats[1].end.push_back(254);  // one is too few to choose from
  const Filler all(kKey, formats);
  bool other = false;
  for (int secret = 0; secret < 256; ++secret)
    other = other || all.fill(rule, Bytes{static_cast<Byte>(secret)})[0] != 255;
  EXPECT_TRUE(other);
}

TEST(RedactStreamTest, AFrameInWhichNothingIsReplacedIsNotMended) {
  const RedactBook book =
      book_of("[[frame]]\nprotocol='nmea'\n[[redact]]\nname='it'\ntext='secret'\nwith='0'\n");
  RedactStream stream(book, Of::reads);
  ASSERT_TRUE(stream.add(as_bytes("$A*00\r\n$secret*00\r\n$B*00\r\n")));
  ASSERT_TRUE(stream.finish());
  EXPECT_EQ(as_text(stream.take().bytes), "$A*00\r\n$000000*00\r\n$B*00\r\n");
  EXPECT_EQ(stream.wrong_checksums(), 1U);
}

TEST(RedactStreamTest, ARangeIsGivenOnWithTheLastOfItsBytes) {
  const RedactBook book = book_of("[[redact]]\nname='all'\ndir='r'\noffset=0\nsize=32768\nwith='-'\n");
  RedactStream stream(book, Of::reads);
  ASSERT_TRUE(stream.add(Bytes(32767, 'a')));
  EXPECT_EQ(stream.take().bytes.size(), 0U);
  ASSERT_TRUE(stream.add(Bytes(1, 'a')));
  const RedactStream::Ready ready = stream.take();
  EXPECT_EQ(as_text(ready.bytes), std::string(32768, '-'));
  ASSERT_EQ(ready.redactions.size(), 8U);
  EXPECT_EQ(ready.redactions[7], (Redaction{28672, 4096, 0}));
}

TEST(RedactStreamTest, ATextHasNoFramesAndOnlyRulesOfEvents) {
  const RedactBook book = book_of(
      "[[frame]]\nname='f'\nkind='fixed'\nsize=2\n[[redact]]\nname='a'\nat=0\nwith='-'\n"
      "[[redact]]\nname='b'\ntext='b'\nwith='+'\n[[redact]]\nname='c'\ntext='c'\nevents=false\n"
      "[[redact]]\nname='d'\noffset=0\nsize=1\ndir='r'\n");
  EXPECT_EQ(redact(book, "abcd", Of::text).text, "a+cd");
  EXPECT_EQ(redact(book, "abcd", Of::writes).text, "----");
  RedactStream stream(book, Of::text);
  ASSERT_TRUE(stream.add(as_bytes("abcd")));
  ASSERT_TRUE(stream.pause());
  ASSERT_TRUE(stream.finish());
  EXPECT_EQ(as_text(stream.take().bytes), "a+cd");
}

TEST(RedactStreamTest, TheSameComesOutHoweverItIsCut) {
  const RedactBook book = book_of(
      "[[frame]]\nname='f'\nkind='delimited'\nstart='<'\nend='>'\nlongest=40\n"
      "checksum={kind='XOR',at=-2,to=-2,from=1}\n"
      "[[redact]]\nname='a'\npattern='b{1,5}(a[^c]{0,5}c)'\nlongest=12\n[[redact]]\nname='b'\nwhen='aa'\nat="
      "2\nsize=3\n"
      "[[redact]]\nname='c'\ntext='cab'\n[[redact]]\nname='d'\npattern='(?:a|ab)(?:c|bcd)?'\nfiller='digits'"
      "\n");
  std::mt19937 random(7);
  for (int round = 0; round < 60; ++round) {
    std::string text;
    const std::size_t size = round < 50 ? random() % 300 : 100'000;
    for (std::size_t i = 0; i < size; ++i) text += "abc<>d"[random() % 6];
    const Redacted whole = redact(book, text);
    EXPECT_EQ(whole.text.size(), text.size());
    EXPECT_EQ(whole.error, "");
    for (const std::size_t cut : {std::size_t{1}, std::size_t{3}, 1 + random() % 5000})
      ASSERT_EQ(redact(book, text, Of::reads, cut), whole) << text << "\ncut " << cut;
  }
}

TEST(RedactRulesTest, MistakesAreTold) {
  const auto refused = [](const std::string& text) {
    const Result<RuleSet> rules = read_rules("[[redact]]\nname='x'\n" + text, "my.rules");
    return rules ? std::string() : rules.error().message;
  };
  EXPECT_THAT(refused(""), HasSubstr("needs one of text, pattern, offset, at, column, capture"));
  EXPECT_THAT(refused("text='a'\npattern='b'"), HasSubstr("needs one of"));
  EXPECT_THAT(refused("pattern='('"), HasSubstr("no regular expression"));
  EXPECT_THAT(refused("text='a'\nfiller='zeros'"), HasSubstr("'zeros'"));
  EXPECT_THAT(refused("text='a'\nfiller='hex'\nwith='0'"), HasSubstr("besides 'with'"));
  EXPECT_THAT(refused("offset=3\nsize=1"), HasSubstr("no 'dir'"));
  EXPECT_THAT(refused("offset=3\ndir='r'"), HasSubstr("no 'size'"));
  EXPECT_THAT(refused("at=3"), HasSubstr("there is no [[frame]]"));
  EXPECT_THAT(refused("text=''"), HasSubstr("empty"));
  EXPECT_THAT(refused("text='a'\ndir='x'"), HasSubstr("'x'"));
  EXPECT_THAT(refused("text='a'\nlongest=4"), HasSubstr("'longest'"));
  EXPECT_THAT(refused("text='a'"), IsEmpty());
}

}  // namespace
}  // namespace porttape
