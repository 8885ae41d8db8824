#include "libport/formats/gpsd_format.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::exported;
using test::told_lines;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

class GpsdFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> import(std::string_view log, const ImportOptions& options = {}) {
    return test::imported(dir, "t" + std::to_string(++made_), "gpsd", log, options);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

constexpr const char* kGpsdLog =
    "# Name: x\n# Submitted-by: y\n# Serial: 4800 7E2\n$GPGGA,1*00\r\n# note\n\x01#\n";

TEST_F(GpsdFormatTest, CommentsAndTheReceiver) {
  EXPECT_EQ(detect_format(kGpsdLog, ""), find_format("gpsd"));
  const auto tape = import(kGpsdLog);
  EXPECT_THAT(
      told_lines(tape),
      ElementsAre(
          R"({"t_us":0,"event":"settings","by":"device","baud":4800,"databits":7,"parity":"even","stopbits":2})",
          "r 27083 $GPGGA,1*00\\r\\n", "r 33333 \\x01#\\n"));
  EXPECT_THAT(tape->guesses, Contains(HasSubstr("rate that the log tells")));
  EXPECT_THAT(tape->guesses, Contains(HasSubstr("1 lines among the receiver's")));
  EXPECT_THAT(exported(tape->paths, "gpsd"), HasSubstr("\n# Serial: 4800 7E2\n$GPGGA,1*00\r\n\x01#\n"));
}

TEST_F(GpsdFormatTest, ARateThatIsGivenCounts) {
  ImportOptions options;
  options.bytes_at = 9600;
  EXPECT_THAT(told_lines(import("# Serial: 4800\n123456789012345678901234\n", options)),
              ElementsAre(HasSubstr(R"("baud":4800})"), "r 26041 123456789012345678901234\\n"));
  const auto without = import("# Name: x\nab\ncd\n");
  EXPECT_THAT(told_lines(without), ElementsAre("r 0 ab\\n", "r 1 cd\\n"));
  EXPECT_THAT(without->guesses, Contains(HasSubstr("--bytes-at")));
}

TEST_F(GpsdFormatTest, ALongCommentIsOneAndLongDataIsAll) {
  const std::string comment = "#" + std::string(10'000, 'c') + "\n";
  const std::string data = std::string(10'000, 'd') + "#\n";
  const auto tape = import(comment + data);
  EXPECT_EQ(tape->blocks, 3U);
  const std::string back = exported(tape->paths, "gpsd");
  EXPECT_EQ(back.substr(back.find('d', back.find("convert\n"))), data);
}

}  // namespace
}  // namespace porttape
