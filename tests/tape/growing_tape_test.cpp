#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event_file.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::block_bytes;
using testing::ElementsAre;

// A file whose bytes a test changes while it is read.
struct Growing {
  Bytes bytes;
  std::function<void()> on_read;  // called before each read, once
};

class GrowingSource final : public ByteSource {
 public:
  explicit GrowingSource(Growing& file) : file_(&file) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    if (const auto now = std::exchange(file_->on_read, {})) now();
    const std::size_t begin = std::min<std::size_t>(offset, file_->bytes.size());
    const std::size_t size = std::min(into.size(), file_->bytes.size() - begin);
    std::copy_n(file_->bytes.begin() + static_cast<std::ptrdiff_t>(begin), size, into.begin());
    return size;
  }
  Result<std::uint64_t> size() override { return file_->bytes.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  Growing* file_;
  std::string name_ = "growing";
};

class GrowingTape : public testing::Test {
 protected:
  TapeReader open() {
    auto reader = TapeReader::from_sources(
        {std::make_unique<GrowingSource>(read), std::make_unique<GrowingSource>(write),
         std::make_unique<GrowingSource>(events)},
        {.grows = true});
    if (!reader) throw std::runtime_error(reader.error().message);
    return std::move(*reader);
  }
  static void add(Growing& file, const Bytes& bytes) {
    file.bytes.insert(file.bytes.end(), bytes.begin(), bytes.end());
  }
  void add_event(const std::string& line) { add(events, test::bytes_of(line + "\n")); }

  Growing read;
  Growing write;
  Growing events{test::bytes_of("{\"format\":\"porttape-events\",\"version\":1}\n"), {}};
};

TEST_F(GrowingTape, GoesOnWithWhatCameAfterItsEnd) {
  TapeReader reader = open();
  EXPECT_THAT(test::read_all(reader), ElementsAre());
  add(write, block_bytes({{10, "ask"}}));
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre("w 10 ask"));
  add(read, block_bytes({{20, "answer"}}));
  add_event(R"({"t_us":30,"event":"mark","text":"x"})");
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre("r 20 answer", "mark 30"));
}

TEST_F(GrowingTape, AnUnfinishedBlockIsReadOnceItIsWhole) {
  TapeReader reader = open();
  const Bytes block = block_bytes({{10, "ask"}});
  for (std::size_t size = 1; size < block.size(); ++size) {
    write.bytes.assign(block.begin(), block.begin() + static_cast<std::ptrdiff_t>(size));
    reader.read_on();
    EXPECT_THAT(test::read_all(reader), ElementsAre());
  }
  write.bytes = block;
  events.bytes.push_back('{');
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre("w 10 ask"));
  events.bytes.pop_back();
  add_event(R"({"t_us":30,"event":"close"})");
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre("close 30"));
}

// As a recorder does whose disk was full.
TEST_F(GrowingTape, AnUnfinishedBlockMayBeCutOffAndAnotherTakeItsPlace) {
  TapeReader reader = open();
  const Bytes torn = block_bytes({{10, std::string(1000, 'x')}});
  write.bytes.assign(torn.begin(), torn.begin() + 500);
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre());
  write.bytes = block_bytes({{20, "short"}});
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre("w 20 short"));
}

TEST_F(GrowingTape, WhatComesToAFileThatWasLookedAtIsNotTooLate) {
  TapeReader reader = open();
  EXPECT_THAT(test::read_all(reader), ElementsAre());
  // After the reads were looked at, and before the writes are, something comes to both.
  write.on_read = [this] {
    add(read, block_bytes({{10, "pushed"}}));
    add(write, block_bytes({{20, "ask"}}));
  };
  reader.read_on();
  EXPECT_THAT(test::read_all(reader), ElementsAre("r 10 pushed", "w 20 ask"));
}

TEST_F(GrowingTape, EachOfItsFilesIsReadOnWhereItHasGrown) {
  auto reader =
      TapeReader::from_sources({std::make_unique<GrowingSource>(read), std::make_unique<GrowingSource>(write),
                                std::make_unique<GrowingSource>(events)},
                               TapeReader::Options{});
  ASSERT_TRUE(reader);
  EXPECT_THAT(test::read_all(*reader), testing::IsEmpty());
  add(read, block_bytes({{5, "r"}}));
  EXPECT_THAT(test::read_all(*reader), testing::IsEmpty()) << "until it is to read on";
  reader->read_on();
  EXPECT_THAT(test::read_all(*reader), ElementsAre("r 5 r"));
  add(write, block_bytes({{6, "w"}}));
  reader->read_on();
  EXPECT_THAT(test::read_all(*reader), ElementsAre("w 6 w"));
  add_event(R"({"t_us":7,"event":"close"})");
  reader->read_on();
  EXPECT_THAT(test::read_all(*reader), ElementsAre("close 7"));
}

// Gets one byte more with each so many reads.
class TricklingSource final : public ByteSource {
 public:
  TricklingSource(std::string text, std::size_t reads_a_byte, std::size_t reads)
      : text_(std::move(text)), reads_a_byte_(reads_a_byte), reads_(reads) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    const std::size_t there = std::min(text_.size(), reads_++ / reads_a_byte_);
    const std::size_t begin = std::min<std::size_t>(offset, there);
    const std::size_t size = std::min(into.size(), there - begin);
    std::copy_n(text_.begin() + static_cast<std::ptrdiff_t>(begin), size, into.begin());
    return size;
  }
  Result<std::uint64_t> size() override { return text_.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::string text_;
  std::size_t reads_a_byte_;
  std::size_t reads_;
  std::string name_ = "trickling";
};

TEST(GrowingEvents, AreReadWholeWheneverAByteOfThemComes) {
  const std::string text =
      "{\"format\":\"porttape-events\",\"version\":1}\n{\"t_us\":5,\"event\":\"open\"}\n"
      "{\"t_us\":7,\"event\":\"close\"}\n";
  for (std::size_t reads_a_byte = 1; reads_a_byte <= 5; ++reads_a_byte) {
    for (std::size_t reads = 0; reads < reads_a_byte; ++reads) {
      auto file = EventFile::create(std::make_unique<TricklingSource>(text, reads_a_byte, reads));
      ASSERT_TRUE(file) << file.error().message;
      std::vector<std::int64_t> times;
      for (std::size_t looks = 0; times.size() < 2 && looks < text.size() * reads_a_byte; ++looks) {
        const EventFile::Step step = file->next();
        ASSERT_NE(step, EventFile::Step::failed) << file->error().message;
        if (step == EventFile::Step::event) {
          times.push_back(to_us(file->event().at));
        } else {
          EXPECT_EQ(file->next(), EventFile::Step::end) << "until it is to read on";
          file->read_on();
        }
      }
      EXPECT_THAT(times, ElementsAre(5, 7)) << reads_a_byte << ' ' << reads;
      ASSERT_TRUE(file->header());
      EXPECT_EQ(file->header_line(), text.substr(0, text.find('\n')));
    }
  }
}

}  // namespace
}  // namespace porttape
