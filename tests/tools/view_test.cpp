#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <utility>
#include <vector>
#include <zlib.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/formats/base64.hpp"
#include "libport/tape/tape_reader.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/tools/run.hpp"
#include "tools/view_writer.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::Not;

std::string unpacked(const std::string& base64) {
  const Bytes packed = bytes_of_base64(base64).value_or(Bytes{});
  std::string out(std::size_t{16} << 20U, '\0');
  uLongf size = out.size();
  EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(out.data()), &size, packed.data(), packed.size()), Z_OK);
  out.resize(size);
  return out;
}

// What the page holds of one kind, unpacked.
std::vector<std::string> data_of(const std::string& page, const std::string& kind) {
  const std::string begin = "<script type=\"text/plain\" data-of=\"" + kind + "\">";
  std::vector<std::string> out;
  for (std::size_t at = page.find(begin); at != std::string::npos; at = page.find(begin, at + 1)) {
    const std::size_t from = at + begin.size();
    out.push_back(unpacked(page.substr(from, page.find("</script>", from) - from)));
  }
  return out;
}

struct Varints {
  std::string bytes;
  std::size_t at = 0;

  std::uint64_t next() {
    std::uint64_t value = 0;
    for (unsigned shift = 0;; shift += 7) {
      const auto byte = static_cast<std::uint8_t>(bytes.at(at++));
      value |= std::uint64_t{byte & 0x7fU} << shift;
      if (byte < 0x80) return value;
    }
  }
  std::string take(std::size_t size) {
    at += size;
    return bytes.substr(at - size, size);
  }
  std::size_t next_u32() {
    std::size_t value = 0;
    for (unsigned shift = 0; shift < 32; shift += 8)
      value |= std::size_t{static_cast<std::uint8_t>(bytes.at(at++))} << shift;
    return value;
  }
};

struct Step {
  char what = 'r';  // r, w, e
  std::int64_t us = 0;
  std::string text;  // of an event; of a block: filled in at the end
  std::size_t length = 0;

  friend bool operator==(const Step&, const Step&) = default;
};

struct Held {
  std::vector<Step> steps;
  std::string read;
  std::string written;

  friend bool operator==(const Held&, const Held&) = default;
};

// The chunks as the page reads them.
Held held_in(const std::vector<std::string>& chunks) {
  Held held;
  std::vector<std::pair<std::uint64_t, Step>> events;
  std::vector<Step> blocks;
  std::int64_t us = 0;
  for (const std::string& chunk : chunks) {
    Varints all{chunk};
    const std::size_t block_count = all.next_u32();
    const std::size_t event_count = all.next_u32();
    std::array<std::size_t, 4> sizes{};
    for (std::size_t& size : sizes) size = all.next_u32();
    Varints times{all.take(sizes[0])};
    Varints lengths{all.take(sizes[1])};
    Varints lines{all.take(sizes[2])};
    held.read += all.take(sizes[3]);
    held.written += all.bytes.substr(all.at);
    for (std::size_t i = 0; i < block_count; ++i) {
      us += static_cast<std::int64_t>(times.next());
      const std::uint64_t length = lengths.next();
      blocks.push_back({length % 2 == 1 ? 'w' : 'r', us, {}, length / 2});
    }
    for (std::size_t i = 0; i < event_count; ++i) {
      const auto at = static_cast<std::int64_t>(lines.next() / 2);
      const std::uint64_t before = lines.next();
      events.push_back({before, {'e', at, lines.take(lines.next()), 0}});
    }
  }
  std::size_t next = 0;
  for (std::size_t i = 0; i <= blocks.size(); ++i) {
    for (; next < events.size() && events[next].first == i; ++next) held.steps.push_back(events[next].second);
    if (i < blocks.size()) held.steps.push_back(blocks[i]);
  }
  EXPECT_EQ(next, events.size());
  return held;
}

Held held_on(const TapePaths& paths) {
  auto tape = TapeReader::open(paths);
  Held held;
  for (;;) {
    const auto record = tape->next();
    EXPECT_TRUE(record.has_value());
    if (!record || !*record) return held;
    const Record& each = **record;
    const bool writes = each.kind == RecordKind::write;
    if (writes || each.kind == RecordKind::read) {
      (writes ? held.written : held.read) += as_text(each.data);
      if (each.piece_offset == 0)
        held.steps.push_back({writes ? 'w' : 'r', to_us(each.at), {}, each.block_length});
    } else {
      held.steps.push_back({'e', to_us(each.at), std::string(each.event_line), 0});
    }
  }
}

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class ViewTest : public testing::Test {
 protected:
  // The page of some tapes.
  std::string page(std::vector<std::string> tapes, int status = 0) {
    const std::string path = dir / "page.html";
    std::vector<std::string> args{"view"};
    args.insert(args.end(), tapes.begin(), tapes.end());
    args.insert(args.end(), {"-o", path, "--overwrite"});
    const test::Ran ran = test::run(args);
    EXPECT_EQ(ran.status, status) << ran.err;
    return text_of(path);
  }

  test::TempDir dir;
};

TEST_F(ViewTest, HoldsTheWholeTape) {
  const TapePaths paths =
      test::write_tape(literal_tape(dir / "t"), test::MemoryTape()
                                                    .open(0)
                                                    .write(1'000'000, "ask")
                                                    .read(1'004'000, "answer")
                                                    .event(1'500'000, event::Mark{"here"})
                                                    .read(1'500'000, std::string(300, 'x'))
                                                    .gap(1'800'000, 12, 1'700'000)
                                                    .close(2'000'000));
  const std::string html = page({dir / "t"});
  const Held held = held_in(data_of(html, "tape1"));
  EXPECT_EQ(held, held_on(paths));
  EXPECT_EQ(held.written, "ask");
  const std::string facts = data_of(html, "facts").at(0);
  EXPECT_THAT(facts, HasSubstr("\"blocks\":3,\"events\":5,\"read\":306,\"written\":3"));
  EXPECT_THAT(facts, HasSubstr("\"differences\":null"));
}

TEST_F(ViewTest, HoldsTapesOfManyChunks) {
  std::mt19937 random(7);
  test::MemoryTape tape;
  std::int64_t us = 0;
  std::string data(100'000, '\0');
  for (int i = 0; i < 300; ++i) {
    for (char& c : data) c = static_cast<char>(random());
    us += random() % 3 == 0 ? std::int64_t{5'000'000'000} : static_cast<std::int64_t>(random() % 3000 + 1);
    const std::string_view part = std::string_view(data).substr(random() % data.size());
    if (random() % 2 == 0) {
      tape.read(us, part);
    } else {
      tape.write(us, part);
    }
    if (i % 50 == 0) tape.event(us, event::Mark{"mark"});
  }
  const TapePaths paths = test::write_tape(literal_tape(dir / "t"), tape);
  const std::vector<std::string> chunks = data_of(page({dir / "t"}), "tape1");
  EXPECT_GT(chunks.size(), 2U);
  EXPECT_EQ(held_in(chunks), held_on(paths));
}

TEST_F(ViewTest, NothingOfATapeIsMarkup) {
  const std::string evil = "</script><script>alert(1)</script><!--";
  const std::string tape = test::make_tape(dir, "t", {{10, evil}}, {{5, "b"}},
                                           R"({"t_us":1,"event":"mark","text":"</script><img src=x>"})"
                                           "\n");
  const std::string html = page({tape});
  EXPECT_THAT(html, Not(HasSubstr("alert(1)")));
  EXPECT_THAT(html, Not(HasSubstr("<img")));
  EXPECT_EQ(held_in(data_of(html, "tape1")).read, evil);
  EXPECT_THAT(html, HasSubstr("default-src 'none'; script-src 'sha256-"));
  EXPECT_THAT(html, Not(HasSubstr("{{")));
}

TEST_F(ViewTest, ASecondTapeIsCompared) {
  const std::string good =
      test::make_tape(dir, "good", {{10, "one"}, {30, "two"}}, {{5, "ask"}, {25, "ask"}});
  const std::string bad = test::make_tape(dir, "bad", {{10, "one"}, {30, "tow"}}, {{5, "ask"}, {25, "ask"}});
  const std::string html = page({good, bad});
  EXPECT_EQ(held_in(data_of(html, "tape2")).read, "onetow");
  const std::string facts = data_of(html, "facts").at(0);
  EXPECT_THAT(facts, HasSubstr("\"counts\":\"1 changed\""));
  EXPECT_THAT(facts, HasSubstr("\"kind\":\"changed\""));
  EXPECT_THAT(facts, HasSubstr("\"exchange\":2"));
}

TEST_F(ViewTest, WritesAFileOnceAndTellsDamage) {
  const std::string tape = test::make_tape(dir, "t", {{10, "a"}}, {{5, "b"}});
  const std::string html = dir / "t.html";
  EXPECT_EQ(test::run({"view", tape, "-o", html}).status, 0);
  EXPECT_THAT(test::run({"view", tape, "-o", html}).err, HasSubstr("exists"));
  EXPECT_EQ(test::run({"view", tape, "-o", tape + "r", "--overwrite"}).status, 2);
  std::ofstream(tape + "r", std::ios::app | std::ios::binary) << std::string(64, '\xff');
  const test::Ran damaged = test::run({"view", tape, "-o", html, "--overwrite"});
  EXPECT_EQ(damaged.status, 1);
  EXPECT_THAT(damaged.err, HasSubstr("offset 13"));
  EXPECT_THAT(data_of(text_of(html), "facts").at(0), HasSubstr("offset 13"));
  EXPECT_EQ(held_in(data_of(text_of(html), "tape1")).read, "a");
}

TEST_F(ViewTest, RefusesWhatABrowserCannotHold) {
  const std::string tape = test::make_tape(dir, "t", {{10, "a"}}, {});
  std::filesystem::resize_file(tape + "r", kMostViewBytes + 1);
  const test::Ran ran = test::run({"view", tape, "-o", dir / "t.html"});
  EXPECT_EQ(ran.status, 2);
  EXPECT_THAT(ran.err, HasSubstr("porttape cut"));
  EXPECT_FALSE(std::filesystem::exists(dir / "t.html"));
}

}  // namespace
}  // namespace porttape
