#include "libport/session/make_session.hpp"

#include <memory>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "libport/port/port_options.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

struct NoOptions {};

// A port in memory, or of the type `broken` none.
class MakeSession : public testing::Test {
 protected:
  PortType type(std::string_view name) {
    PortType type{name, {"where"}, "a port of this test"};
    type.options = with_common({{"where", OptionSpec::Kind::text, "here", "a place"}});
    type.read = reads([](const PortOptions&) -> Result<NoOptions> { return NoOptions{}; });
    type.make = [this, name](const PortContext&, const PortSpec&,
                             const std::string&) -> Result<std::unique_ptr<Port>> {
      if (name == "broken") return make_error(Errc::usage, "it is broken");
      return std::unique_ptr<Port>(std::make_unique<MemoryPort>(peer));
    };
    return type;
  }
  // The error of making a channel of the two.
  std::string error_of(const std::string& driver, const std::string& device) {
    const ChannelPorts ports{*parse_port(types, driver), *parse_port(types, device)};
    const auto made = make_channel({&loop, book.log()}, ports, [](int) {});
    return made ? "none" : made.error().message;
  }

  Loop loop;
  LogBook book;
  MemoryPort::Peer peer;
  const PortTypes types{{type("good"), type("broken")}};
};

TEST_F(MakeSession, AnErrorOfEitherPortIsItsOwn) {
  EXPECT_EQ(error_of("good:a", "good:b"), "none");
  EXPECT_EQ(error_of("broken:a", "good:b"), "it is broken");
  EXPECT_EQ(error_of("good:a", "broken:b"), "it is broken");
}

}  // namespace
}  // namespace porttape
