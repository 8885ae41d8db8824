#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::run;
using testing::HasSubstr;

std::string file_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class ConvertTest : public testing::Test {
 protected:
  test::TempDir dir;
  std::string tape = test::make_tape(dir, "t", {{20'000, "yes"}}, {{10'000, "ask"}},
                                     R"({"t_us":0,"event":"open"})"
                                     "\n");
};

TEST_F(ConvertTest, ToTextAndBackByTheNamesAlone) {
  const test::Ran there = run({"convert", tape, "-o", dir / "x.txt"});
  EXPECT_EQ(there.status, 0) << there.err;
  EXPECT_THAT(there.out, HasSubstr("x.txt: text of "));
  const test::Ran back = run({"convert", dir / "x.txt", "-o", dir / "y"});
  EXPECT_EQ(back.status, 0) << back.err;
  EXPECT_THAT(back.out, HasSubstr("y.log: 2 blocks and 1 event in 0.020000 s, from text"));
  for (const char* const file : {"r", "w", "e"})
    EXPECT_EQ(file_text(dir / ("y.log" + std::string(file))), file_text(tape + file));
}

TEST_F(ConvertTest, FromOneFormToAnotherLeavesNoTapeBehind) {
  ASSERT_EQ(run({"convert", tape, "-o", dir / "x.txt"}).status, 0);
  const auto files = [&] { return std::distance(fs::directory_iterator(dir.path()), {}); };
  const auto before = files();
  EXPECT_EQ(run({"convert", dir / "x.txt", "-o", dir / "x.json"}).status, 0);
  EXPECT_EQ(files(), before + 1);
  EXPECT_THAT(file_text(dir / "x.json"), HasSubstr(R"({"t_us":10000,"dir":"w","length":3,"hex":"61736b"})"));
}

TEST_F(ConvertTest, FromOneFormToAnotherIsToldByTheInputsName) {
  ASSERT_EQ(run({"convert", tape, "-o", dir / "x.txt"}).status, 0);
  const test::Ran between = run({"convert", dir / "x.txt", "-o", dir / "x.json"});
  EXPECT_THAT(between.err, testing::StartsWith(dir / "x.txt: 2 blocks and 1 event in "));
}

TEST_F(ConvertTest, ADamagedTapeIsForRecover) {
  std::ofstream(tape + "w", std::ios::binary | std::ios::app) << std::string(20, '\xff');
  const test::Ran damaged = run({"convert", tape, "-o", dir / "x.txt"});
  EXPECT_EQ(damaged.status, 1);
  EXPECT_THAT(damaged.err, HasSubstr("porttape recover"));
}

TEST_F(ConvertTest, RawIsWhatTheDeviceSaid) {
  const test::Ran raw = run({"convert", tape, "--to", "raw", "-o", dir / "x"});
  EXPECT_EQ(file_text(dir / "x"), "yes");
  EXPECT_THAT(raw.out, HasSubstr("not in it  what the driver wrote"));
  const test::Ran made =
      run({"convert", "--from", "raw", dir / "x", "--lead", "2", "--bytes-at", "10", "-o", dir / "z"});
  EXPECT_THAT(made.out, HasSubstr("z.log: 1 block and 2 events in 5.000000 s, from raw\n  guessed  "));
}

TEST_F(ConvertTest, SwappedBytesAreToldAsTheDrivers) {
  std::ofstream(dir / "x") << "hello\n";
  for (const char* const format : {"raw", "minicom"}) {
    const test::Ran made =
        run({"convert", "--from", format, dir / "x", "--swap", "--overwrite", "-o", dir / "z"});
    EXPECT_THAT(made.out, HasSubstr("guessed  all bytes are the driver's")) << made.err;
    EXPECT_THAT(file_text(dir / "z.loge"), HasSubstr("all bytes are the driver's"));
  }
}

TEST_F(ConvertTest, NothingThatIsThereIsLost) {
  ASSERT_EQ(run({"convert", tape, "-o", dir / "x.txt"}).status, 0);
  EXPECT_THAT(run({"convert", tape, "-o", dir / "x.txt"}).err, HasSubstr("exists already"));
  EXPECT_THAT(run({"convert", dir / "x.txt", "-o", tape}).err, HasSubstr("there is a tape"));
  EXPECT_EQ(run({"convert", dir / "x.txt", "--overwrite", "-o", tape}).status, 0);
}

TEST_F(ConvertTest, DamageLeavesNothing) {
  std::ofstream(dir / "bad.txt") << "porttape-text 1\n0 open\n0 r 4\n";
  const test::Ran bad = run({"convert", dir / "bad.txt", "-o", dir / "y"});
  EXPECT_EQ(bad.status, 1);
  EXPECT_THAT(bad.err, testing::EndsWith("bad.txt:3:5: bytes are expected: \"text\" in quotes, or pairs of "
                                         "hexadecimal digits\n"));
  EXPECT_FALSE(fs::exists(dir / "y.logr"));
}

TEST_F(ConvertTest, AFileOfItsFormWithoutRecordsIsAnEmptyTape) {
  std::ofstream(dir / "x.txt") << "porttape-text 1\n";
  const test::Ran made = run({"convert", dir / "x.txt", "-o", dir / "y"});
  EXPECT_EQ(made.status, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("0 blocks and 0 events"));
  std::ofstream(dir / "x.log") << "nothing of minicom's\n";
  const test::Ran none = run({"convert", "--from", "zwave-js", dir / "x.log", "-o", dir / "z"});
  EXPECT_EQ(none.status, 2);
  EXPECT_THAT(none.err, HasSubstr("nothing in it is zwave-js"));
}

TEST_F(ConvertTest, ListsItsFormats) {
  const test::Ran list = run({"convert", "--formats"});
  EXPECT_EQ(list.status, 0);
  EXPECT_THAT(list.out, testing::ContainsRegex("text +read write +editable text"));
}

}  // namespace
}  // namespace porttape
