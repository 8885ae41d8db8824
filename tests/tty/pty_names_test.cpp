#include "libport/tty/pty_names.hpp"

#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

#include <gtest/gtest.h>

#include "libport/loop/loop.hpp"
#include "libport/port/context.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// What is printed meanwhile.
class Printed {
 public:
  Printed() : before_(std::cout.rdbuf(out_.rdbuf())) {}
  ~Printed() { std::cout.rdbuf(before_); }
  Printed(const Printed&) = delete;
  Printed& operator=(const Printed&) = delete;
  [[nodiscard]] std::string text() const { return out_.str(); }

 private:
  std::ostringstream out_;
  std::streambuf* before_;
};

class PtyNamesTest : public testing::Test {
 protected:
  PtyNames names(const std::string& link, bool announces = false) {
    return {PortContext{.loop = &loop, .log = book.log(), .announces = announces}, link, ""};
  }

  Loop loop;
  LogBook book;
  const test::TempDir dir;
};

TEST_F(PtyNamesTest, ALinkLeadsToTheSlaveAndIsWhatADriverIsGiven) {
  PtyNames named = names(dir / "laser");
  ASSERT_TRUE(named.publish("/dev/pts/97").has_value());
  EXPECT_EQ(fs::read_symlink(dir / "laser"), "/dev/pts/97");
  EXPECT_EQ(named.place("/dev/pts/97").path, dir / "laser");
  EXPECT_NE(book.text().find((dir / "laser") + " is there (/dev/pts/97)"), std::string::npos) << book.text();
}

TEST_F(PtyNamesTest, ALinkIsMovedToAnotherSlave) {
  PtyNames named = names(dir / "laser");
  ASSERT_TRUE(named.publish("/dev/pts/97").has_value());
  named.retarget("/dev/pts/98");
  EXPECT_EQ(fs::read_symlink(dir / "laser"), "/dev/pts/98");
}

TEST_F(PtyNamesTest, WithoutANameTheSlaveItselfIsGivenAndPrinted) {
  PtyNames bare = names("", true);
  const Printed printed;
  ASSERT_TRUE(bare.publish("/dev/pts/97").has_value());
  EXPECT_EQ(bare.place("/dev/pts/97").path, "/dev/pts/97");
  bare.retarget("/dev/pts/98");
  EXPECT_EQ(printed.text(), "/dev/pts/97\n/dev/pts/98\n");
  EXPECT_EQ(book.text(), "");
}

TEST_F(PtyNamesTest, NothingIsPrintedWhereThereIsANameOrNobodyAsksForIt) {
  const Printed printed;
  ASSERT_TRUE(names(dir / "laser", true).publish("/dev/pts/97").has_value());
  ASSERT_TRUE(names("", false).publish("/dev/pts/97").has_value());
  EXPECT_EQ(printed.text(), "");
}

TEST_F(PtyNamesTest, AFileThatIsThereIsLeftAlone) {
  std::ofstream(dir / "laser") << "mine\n";
  PtyNames named = names(dir / "laser");
  EXPECT_FALSE(named.publish("/dev/pts/97").has_value());
  EXPECT_TRUE(fs::is_regular_file(dir / "laser"));
  EXPECT_EQ(named.place("/dev/pts/97").path, "/dev/pts/97");
}

}  // namespace
}  // namespace porttape
