#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/tape_reader.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/tools/run.hpp"
#include "tools/tape_plot.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::Not;

std::size_t times_in(const std::string& text, const std::string& word) {
  std::size_t count = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
  return count;
}

class PlotTest : public testing::Test {
 protected:
  std::string picture(const test::MemoryTape& tape, const std::vector<std::string>& notes = {}) {
    const TapePaths paths = test::write_tape(literal_tape(dir / ("t" + std::to_string(++made_))), tape);
    auto reader = TapeReader::open(paths);
    TapePlot plot;
    for (;;) {
      const auto record = reader->next();
      if (!record || !*record) break;
      plot.add(**record);
    }
    return plot.svg("t.log", notes);
  }

  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(PlotTest, ShowsBothDirectionsEventsAndAnswers) {
  const std::string svg = picture(test::MemoryTape()
                                      .open(0)
                                      .write(1'000'000, "ask")
                                      .read(1'004'000, "answer")
                                      .event(1'500'000, event::Mark{"here <&>"})
                                      .gap(1'800'000, 12, 1'700'000)
                                      .close(2'000'000));
  EXPECT_THAT(svg, testing::StartsWith("<svg xmlns="));
  EXPECT_THAT(svg, testing::EndsWith("</svg>\n"));
  EXPECT_THAT(
      svg,
      HasSubstr("2 s in all; from the device 6 B in 1 block, from the driver 3 B in 1 block; 1 exchange"));
  // One bar each, at the middle of the axis.
  EXPECT_EQ(times_in(svg, "width=\"1.2\""), 2U);
  EXPECT_THAT(svg, HasSubstr("<rect x=\"636\" y=\"100.0\" width=\"1.2\" height=\"70.0\" class=\"read\"/>"));
  EXPECT_THAT(svg, HasSubstr("median 4 ms"));
  EXPECT_THAT(svg, HasSubstr("<title>1 answer</title>"));
  EXPECT_THAT(svg, HasSubstr(">here &lt;&amp;&gt;</text>"));
  EXPECT_THAT(svg, HasSubstr("<title>1.8 s: gap: 12 bytes are missing, disk full</title>"));
  EXPECT_THAT(svg, Not(HasSubstr("here <&>")));
}

TEST_F(PlotTest, AnEmptyTapeAndDamageAreToldInIt) {
  const std::string svg = picture(test::MemoryTape().open(0), {"r is damaged"});
  EXPECT_THAT(svg, HasSubstr("no request of this tape is answered"));
  EXPECT_THAT(svg, HasSubstr("class=\"bad\">r is damaged<"));
}

TEST_F(PlotTest, ALongTapeIsAsLargeAsAShortOne) {
  test::MemoryTape tape;
  for (int i = 0; i < 200'000; ++i) tape.read(i * std::int64_t{977}, "x");
  const std::string svg = picture(tape);
  EXPECT_LT(svg.size(), 300'000U);
  EXPECT_THAT(svg, HasSubstr("from the device 200 kB in 200000 blocks"));
}

TEST_F(PlotTest, WritesAFileOnceAndTellsDamage) {
  const std::string tape = test::make_tape(dir, "t", {{10, "a"}}, {{5, "b"}});
  const std::string svg = dir / "t.svg";
  EXPECT_EQ(test::run({"plot", tape, "-o", svg}).status, 0);
  EXPECT_THAT(test::run({"plot", tape, "-o", svg}).err, HasSubstr("exists"));
  EXPECT_EQ(test::run({"plot", tape, "-o", svg, "--overwrite"}).status, 0);
  EXPECT_EQ(test::run({"plot", tape, "-o", tape + "r", "--overwrite"}).status, 2);
  std::ofstream(tape + "r", std::ios::app | std::ios::binary) << std::string(64, '\xff');
  const test::Ran damaged = test::run({"plot", tape, "-o", svg, "--overwrite"});
  EXPECT_EQ(damaged.status, 1);
  EXPECT_THAT(damaged.err, HasSubstr("offset 13"));
  std::ifstream file(svg);
  EXPECT_THAT(std::string(std::istreambuf_iterator<char>(file), {}), HasSubstr("what is sound is drawn"));
}

}  // namespace
}  // namespace porttape
