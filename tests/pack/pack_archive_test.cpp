#include "libport/pack/pack_archive.hpp"

#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/payload_totals.hpp"
#include "tests/support/memory_pack.hpp"

namespace porttape {
namespace {

using test::MemoryPackSink;
using testing::HasSubstr;
using Files = std::vector<std::pair<std::string, std::string>>;

PackedFile told(const std::string& name, const std::string& content) {
  PayloadCounter digest;
  digest.add(as_bytes(content));
  return {name, content.size(), *digest.totals().xxh3};
}

class PackArchiveTest : public testing::Test {
 protected:
  // The files as they are, behind a manifest of `listed`.
  std::string pack(const Files& files, const Files& listed, PackFormat format = PackFormat::zstd) {
    PackManifest manifest{.tapes = {{"a.log", "", "sound", {}}}};
    for (const auto& [name, content] : listed) manifest.files.push_back(told(name, content));
    Files all = {{"manifest.json", to_json(manifest)}};
    all.insert(all.end(), files.begin(), files.end());
    return archive(all, format);
  }
  std::string archive(const Files& files, PackFormat format = PackFormat::zstd) {
    std::string bytes;
    auto writer = PackWriter::begin(
        [&](ByteView part) -> Result<void> {
          bytes += as_text(part);
          return {};
        },
        format, "p");
    EXPECT_TRUE(writer);
    for (const auto& [name, content] : files) {
      EXPECT_TRUE(writer->begin_file(name, content.size()));
      EXPECT_TRUE(writer->write(as_bytes(content)));
    }
    EXPECT_TRUE(writer->finish());
    return bytes;
  }
  // What is wrong with it; empty: nothing.
  std::string read(const std::string& bytes, const PackLimits& limits = {}) {
    MemorySource source("p", Bytes(bytes.begin(), bytes.end()));
    sink = {};
    const auto manifest = read_pack(source, sink, limits);
    EXPECT_FALSE(sink.twice);
    EXPECT_FALSE(sink.odd);
    return manifest ? "" : manifest.error().message;
  }

  MemoryPackSink sink;
  Files tape = {{"a.logr", std::string(100'000, 'r')}, {"a.logw", ""}, {"a.loge", "{}\n"}};
};

TEST_F(PackArchiveTest, ComesOutAsItWentIn) {
  for (const PackFormat format : {PackFormat::gzip, PackFormat::zstd}) {
    EXPECT_EQ(read(pack(tape, tape, format)), "");
    for (const auto& [name, content] : tape) EXPECT_EQ(sink.files[name], content);
    EXPECT_EQ(sink.files.size(), 4U);
  }
}

TEST_F(PackArchiveTest, TheOrderIsFreeButForTheManifest) {
  const Files turned(tape.rbegin(), tape.rend());
  EXPECT_EQ(read(pack(turned, tape)), "");
  EXPECT_THAT(read(archive(tape)), HasSubstr("first file is no manifest.json"));
}

TEST_F(PackArchiveTest, OnlyWhatTheManifestTellsOf) {
  Files more = tape;
  more.emplace_back("x", "1");
  EXPECT_THAT(read(pack(more, tape)), HasSubstr("'x', of which manifest.json does not tell"));
  EXPECT_THAT(read(pack(more, more)), HasSubstr("names a file 'x', which belongs to none of its tapes"));
  EXPECT_TRUE(sink.files.empty());
  EXPECT_THAT(read(pack({tape[0], tape[1]}, tape)), HasSubstr("lacks 'a.loge'"));
  Files other = tape;
  other[2].second = "[]\n";
  EXPECT_THAT(read(pack(other, tape)), HasSubstr("'a.loge' is not what was packed"));
  other[2].second = "{}";
  EXPECT_THAT(read(pack(other, tape)), HasSubstr("2 bytes, and 3 in manifest.json"));
  more = tape;
  more.push_back(tape[0]);
  EXPECT_THAT(read(pack(more, tape)), HasSubstr("twice"));
  more.back() = {"manifest.json", "{}"};
  EXPECT_THAT(read(pack(more, tape)), HasSubstr("twice"));
  for (const char* const name : {"../x", "/x", "b/x", "..", "a\\b", ".a", "-a",
                                 "a\xc2\x9b"
                                 "b",
                                 "a\xe2\x80\xae"
                                 "b"}) {
    more.back() = {name, "1"};
    EXPECT_NE(read(pack(more, tape)), "") << name;
  }
}

TEST_F(PackArchiveTest, LimitsHold) {
  EXPECT_THAT(read(pack(tape, tape), {.bytes = 100'002}), HasSubstr("--max-size"));
  EXPECT_TRUE(sink.files.empty());
  EXPECT_EQ(read(pack(tape, tape), {.bytes = 100'003}), "");
  EXPECT_THAT(read(pack(tape, tape), {.files = 2}), HasSubstr("3 files"));
}

TEST_F(PackArchiveTest, ASmallPackUnpacksToNoMoreThanIsUsual) {
  const auto with_zeros = [this](std::size_t count) {
    const Files files = {{"a.logr", std::string(count, '\0')}};
    return pack(files, files);
  };
  const std::string bytes = with_zeros(PackLimits::kUsualBytes + 1);
  EXPECT_LT(bytes.size(), 100'000U);
  EXPECT_EQ(read(bytes), "it unpacks to 100000001 bytes; --max-size 101 (megabytes) allows it");
  EXPECT_TRUE(sink.files.empty());
  EXPECT_EQ(read(bytes, {.bytes = 101'000'000}), "");
  EXPECT_EQ(read(with_zeros(PackLimits::kUsualBytes)), "");
}

TEST_F(PackArchiveTest, WhatIsCutOffOrFollowedIsTold) {
  for (const PackFormat format : {PackFormat::gzip, PackFormat::zstd}) {
    const std::string whole = pack(tape, tape, format);
    for (std::size_t size = 0; size < whole.size(); ++size)
      ASSERT_NE(read(whole.substr(0, size)), "") << size;
    EXPECT_NE(read(whole + "x"), "");
    EXPECT_NE(read(whole + std::string(5000, '\0')), "");
    EXPECT_NE(read(whole + whole), "");
  }
}

TEST_F(PackArchiveTest, AFlippedByteIsTold) {
  const std::string whole = pack(tape, tape, PackFormat::zstd);
  std::size_t unseen = 0;
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string bad = whole;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    // Of the tar's own words (a mode, a padding) and of zstd's header some are of no matter.
    if (read(bad).empty()) {
      ++unseen;
      for (const auto& [name, content] : tape) EXPECT_EQ(sink.files[name], content);
    }
  }
  EXPECT_LT(unseen, whole.size() / 4);
}

}  // namespace
}  // namespace porttape
