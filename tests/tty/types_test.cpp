#include "libport/tty/types.hpp"

#include <optional>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "libport/port/port_options.hpp"
#include "libport/tty/pty_port.hpp"
#include "libport/tty/serial_port.hpp"

namespace porttape {
namespace {

Result<PortSpec> read_spec(const PortType& type, OptionValues values) {
  const Result<PortOptions> checked = check_options(PortOptions{&type, std::move(values)});
  if (!checked) return checked.error();
  return PortSpec::read(*checked);
}

class SerialTypeTest : public testing::Test {
 protected:
  SerialOptions options(OptionValues values) const {
    const Result<PortSpec> spec = read_spec(type, std::move(values));
    EXPECT_TRUE(spec.has_value()) << spec.error().message;
    return spec ? *spec->get<SerialOptions>() : SerialOptions{};
  }
  const PortType type = serial_type();
};

TEST_F(SerialTypeTest, LeavesTheModemLinesAndFollowsTheDriverByDefault) {
  const SerialOptions found = options({});
  EXPECT_EQ(found.device, "/dev/ttyS0");
  EXPECT_EQ(found.dtr, std::nullopt);
  EXPECT_EQ(found.rts, std::nullopt);
  EXPECT_FALSE(found.wait);
  EXPECT_TRUE(found.follow);
  EXPECT_FALSE(found.uucp_lock);
  EXPECT_EQ(found.lock_folder, "/var/lock");
}

TEST_F(SerialTypeTest, EachOptionIsItsOwn) {
  EXPECT_EQ(options({{"device", "/dev/ttyUSB3"}}).device, "/dev/ttyUSB3");
  EXPECT_EQ(options({{"baud", "4800"}}).settings.baud, 4800U);
  SerialOptions found = options({{"dtr", "on"}, {"rts", "off"}});
  EXPECT_EQ(found.dtr, true);
  EXPECT_EQ(found.rts, false);
  found = options({{"dtr", "off"}});
  EXPECT_EQ(found.dtr, false);
  EXPECT_EQ(found.rts, std::nullopt);
  found = options({{"wait", "1"}});
  EXPECT_TRUE(found.wait);
  EXPECT_FALSE(found.uucp_lock);
  found = options({{"uucplock", "1"}});
  EXPECT_FALSE(found.wait);
  EXPECT_TRUE(found.uucp_lock);
  EXPECT_FALSE(options({{"settings", "keep"}}).follow);
  EXPECT_TRUE(options({{"settings", "follow"}}).follow);
}

TEST_F(SerialTypeTest, TakesNoOtherWords) {
  for (const auto& [option, value] : {std::pair("dtr", "high"), {"rts", "1"}, {"settings", "leave"}}) {
    const Result<PortSpec> spec = read_spec(type, {{option, value}});
    ASSERT_FALSE(spec.has_value()) << option;
    EXPECT_EQ(spec.error().code, Errc::usage);
  }
}

TEST_F(SerialTypeTest, OneDeviceIsOnePortsAndIsRecordedAsASerialLog) {
  EXPECT_TRUE(type.exclusive);
  EXPECT_EQ(type.recorded_as, "seriallog");
}

class PtyTypeTest : public testing::Test {
 protected:
  PtyOptions options(OptionValues values) const {
    const Result<PortSpec> spec = read_spec(type, std::move(values));
    EXPECT_TRUE(spec.has_value()) << spec.error().message;
    return spec ? *spec->get<PtyOptions>() : PtyOptions{};
  }
  const PortType type = pty_type();
};

TEST_F(PtyTypeTest, IsItsUsersAloneByDefault) {
  const PtyOptions found = options({});
  EXPECT_EQ(found.link, "");
  EXPECT_EQ(found.bind, "");
  EXPECT_EQ(found.access.mode, 0600U);
  EXPECT_EQ(found.access.owner, "");
  EXPECT_EQ(found.access.group, "");
}

TEST_F(PtyTypeTest, EachOptionIsItsOwn) {
  const PtyOptions found =
      options({{"link", "/a"}, {"bind", "/b"}, {"mode", "0640"}, {"owner", "ann"}, {"group", "dialout"}});
  EXPECT_EQ(found.link, "/a");
  EXPECT_EQ(found.bind, "/b");
  EXPECT_EQ(found.access.mode, 0640U);
  EXPECT_EQ(found.access.owner, "ann");
  EXPECT_EQ(found.access.group, "dialout");
}

TEST_F(PtyTypeTest, AModeIsOctal) {
  const Result<PortSpec> spec = read_spec(type, {{"mode", "0698"}});
  ASSERT_FALSE(spec.has_value());
  EXPECT_EQ(spec.error().code, Errc::usage);
}

TEST_F(PtyTypeTest, ClaimsTheNamesThatItHas) {
  const auto claims = [this](OptionValues values) {
    std::string all;
    for (const PortType::Claim& claim : type.claims(*read_spec(type, std::move(values))))
      all += std::string(claim.first) + "=" + claim.second + " ";
    return all;
  };
  EXPECT_EQ(claims({}), "");
  EXPECT_EQ(claims({{"link", "/a"}}), "link=/a ");
  EXPECT_EQ(claims({{"bind", "/b"}}), "link=/b ");
  EXPECT_EQ(claims({{"link", "/a"}, {"bind", "/b"}}), "link=/a link=/b ");
}

}  // namespace
}  // namespace porttape
