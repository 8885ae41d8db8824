#include "libport/base/tty_device.hpp"

#include <cstdlib>
#include <fcntl.h>
#include <string>
#include <sys/sysmacros.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

TEST(TtyDevice, APtyIsKnownByItsMajorNumber) {
  for (const unsigned kind : {136U, 143U}) EXPECT_TRUE(is_pty(makedev(kind, 7))) << kind;
  for (const unsigned kind : {135U, 144U}) EXPECT_FALSE(is_pty(makedev(kind, 7))) << kind;
}

TEST(TtyDevice, PtysOfOneNumberAreTheSameInOneFileSystemAlone) {
  const TtyDevice one{.number = makedev(136, 2), .file_system = 7};
  EXPECT_TRUE(one.is(one));
  EXPECT_FALSE(one.is({.number = makedev(136, 2), .file_system = 8}));
  EXPECT_FALSE(one.is({.number = makedev(136, 3), .file_system = 7}));
  EXPECT_TRUE(one.is({.number = makedev(136, 2)})) << "where it is not known";
  EXPECT_TRUE((TtyDevice{.number = makedev(136, 2)}).is(one));
}

TEST(TtyDevice, APathAndAnOpenFileAreTheSame) {
  const UniqueFd master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_TRUE(master);
  ASSERT_EQ(::unlockpt(master.get()), 0);
  const std::string path = ::ptsname(master.get());
  const UniqueFd tty(::open(path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_TRUE(tty) << path;
  const auto at = tty_device_at(path);
  const auto of = tty_device_of(tty.get());
  ASSERT_TRUE(at && of);
  EXPECT_TRUE(at->is(*of));
  EXPECT_EQ(at->file_system, of->file_system);
  EXPECT_TRUE(at->file_system.has_value());
  EXPECT_FALSE(tty_device_at("/dev/null")->file_system.has_value());
}

TEST(TtyDevice, AFileThatIsNoneAndOneThatIsAPlaceAloneAreNoDevice) {
  EXPECT_FALSE(tty_device_at("/"));
  EXPECT_FALSE(tty_device_at("/no/such/device"));
  EXPECT_FALSE(tty_device_of(-1));
  const UniqueFd place(::open("/dev/null", O_PATH | O_CLOEXEC));
  ASSERT_TRUE(place);
  EXPECT_FALSE(tty_device_of(place.get()));
}

}  // namespace
}  // namespace porttape
