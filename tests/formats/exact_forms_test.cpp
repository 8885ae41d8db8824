#include <random>
#include <string>

#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"
#include "tests/support/random_tape.hpp"

namespace porttape {
namespace {

using test::exported;
using test::imported;
using test::MemoryTape;

// Of each form that holds all of a tape.
class ExactFormTest : public testing::TestWithParam<const char*> {
 protected:
  TapePaths tape(const MemoryTape& records) {
    return test::write_tape(literal_tape(dir / ("t" + std::to_string(++made_))), records,
                            {.device = "serial:/dev/ttyUSB0", .driver = "pty:/tmp/laser"});
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_P(ExactFormTest, RandomTapesComeBackExactly) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    std::mt19937 random(seed);
    const auto choose = [&](std::uint32_t n) {
      return n == 0 ? 0U : static_cast<std::uint32_t>(random()) % n;
    };
    const TapePaths paths =
        tape(test::random_tape(choose, {.sessions = true, .hang_ups = true, .gaps = true, .signals = true}));
    const std::string text = exported(paths, GetParam());
    const auto made = imported(dir, "back" + std::to_string(seed), GetParam(), text);
    ASSERT_TRUE(made) << "seed " << seed << ": " << made.error().message;
    EXPECT_EQ(test::lines_on(made->paths), test::lines_on(paths)) << "seed " << seed;
    EXPECT_EQ(test::header_line_of(made->paths), test::header_line_of(paths)) << "seed " << seed;
    EXPECT_EQ(find_format(GetParam()), detect_format(text, ""));
    EXPECT_EQ(exported(made->paths, GetParam()), text) << "seed " << seed;
  }
}

TEST_P(ExactFormTest, ATapeWithoutRecordsComesBack) {
  for (const bool ended : {true, false}) {
    const TapePaths paths = literal_tape(dir / (ended ? "ended" : "open"));
    auto made = NewTape::create(paths, TapeHeader{.device = "serial:/dev/ttyS0", .driver = "pty:/tmp/p"},
                                {.sync = false});
    ASSERT_TRUE(made && made->finish(ended ? std::optional(tape_time_us(7)) : std::nullopt));
    const std::string text = exported(paths, GetParam());
    Evidence evidence = Evidence::of("evidence", text);
    ImportTape tape(literal_tape(dir / (ended ? "back" : "open-back")), {.sync = false}, {}, "evidence");
    const auto end = find_format(GetParam())->import_tape(evidence, tape, {});
    ASSERT_TRUE(end) << end.error().message;
    EXPECT_TRUE(tape.is_sure());
    const auto back = tape.finish(*end);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(exported(back->paths, GetParam()), text);
  }
}

TEST_P(ExactFormTest, LargeBlocksComeBack) {
  std::string large;
  for (int i = 0; i < 3'000'000; ++i) large += static_cast<char>(i % 251);
  const TapePaths paths = tape(MemoryTape().write(5, large).read(5, "").read(6, large));
  EXPECT_EQ(test::lines_of(imported(dir, "back", GetParam(), exported(paths, GetParam()))),
            test::lines_on(paths));
}

INSTANTIATE_TEST_SUITE_P(Each, ExactFormTest, testing::Values("text", "json", "csv", "pcapng", "mcap"),
                         [](const auto& each) { return std::string(each.param); });

}  // namespace
}  // namespace porttape
