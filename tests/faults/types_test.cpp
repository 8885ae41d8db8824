// What the options `faults` and `seed` of a port become.

#include "libport/faults/types.hpp"

#include <cstdint>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "libport/faults/fault_port.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kPort = "tcp:127.0.0.1:7";

FaultOptions options(const std::string& more) {
  const Result<PortSpec> spec = parse_port(kPort + more);
  if (!spec || spec->get<FaultOptions>() == nullptr) {
    ADD_FAILURE() << more;
    return {};
  }
  return *spec->get<FaultOptions>();
}

std::string refused(const std::string& more) {
  const Result<PortSpec> spec = parse_port(kPort + more);
  if (spec) return "nothing is wrong";
  EXPECT_EQ(spec.error().code, Errc::usage);
  return spec.error().message;
}

TEST(FaultOptionsTest, APortWithoutAPlanHasNone) {
  const Result<PortSpec> spec = parse_port(kPort);
  ASSERT_TRUE(spec.has_value());
  EXPECT_EQ(spec->get<FaultOptions>(), nullptr);
}

TEST(FaultOptionsTest, AreThePlanAndTheSeed) {
  const FaultOptions given = options(",faults=drop:p=0.5,seed=7,wait");
  ASSERT_EQ(given.plan.faults.size(), 1U);
  EXPECT_EQ(given.plan.faults.front().kind, Fault::Kind::drop);
  EXPECT_EQ(given.seed, 7U);
  EXPECT_TRUE(given.waits);
  EXPECT_FALSE(given.always_open);
  EXPECT_TRUE(options(",faults=drop:p=0.5,alwaysopen").always_open);
  EXPECT_FALSE(options(",faults=drop:p=0.5,alwaysopen").waits);
}

// So that a message or a header that tells the options is enough to make the same damage again.
TEST(FaultOptionsTest, ASeedThatIsDrawnIsAmongTheOptionsAndOneAProgram) {
  const Result<PortSpec> one = parse_port(std::string(kPort) + ",faults=drop:p=0.5");
  ASSERT_TRUE(one.has_value());
  const std::uint64_t seed = one->get<FaultOptions>()->seed;
  EXPECT_LT(seed, 1'000'000'000U);
  EXPECT_THAT(one->spelled(), HasSubstr("seed=" + std::to_string(seed)));
  EXPECT_EQ(options(",faults=corrupt:p=0.5").seed, seed);
}

TEST(FaultOptionsTest, TheLargestSeedIsAWholeNumberAnywhere) {
  EXPECT_EQ(options(",faults=drop:p=0.5,seed=9007199254740991").seed, 9'007'199'254'740'991U);
  EXPECT_EQ(options(",faults=drop:p=0.5,seed=0").seed, 0U);
  EXPECT_THAT(refused(",faults=drop:p=0.5,seed=9007199254740993"), HasSubstr("'seed'"));
  EXPECT_THAT(refused(",faults=drop:p=0.5,seed=-1"), HasSubstr("'seed'"));
}

TEST(FaultOptionsTest, ASeedWithoutFaultsIsRefused) {
  EXPECT_EQ(refused(",seed=7"),
            "port 'tcp:127.0.0.1:7,seed=7': option 'seed' is that of faults, and there are "
            "none; accepted: with faults");
}

TEST(FaultOptionsTest, APlanThatIsNoneIsRefusedWithTheReason) {
  EXPECT_THAT(refused(",faults=break:p=0.5"),
              StartsWith("port 'tcp:127.0.0.1:7,faults=break:p=0.5': option 'faults': "));
  EXPECT_THAT(refused(",faults=break:p=0.5"), HasSubstr("break"));
}

}  // namespace
}  // namespace porttape
