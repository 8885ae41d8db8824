// A wrapper around any port type, as a room of its own would make it.

#include <array>
#include <memory>
#include <optional>
#include <string>

#include <gtest/gtest.h>

#include "libport/port/filter_port.hpp"
#include "libport/port/port_options.hpp"
#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

struct PlainOptions {
  std::string where;
};
struct NoiseOptions {
  Byte added = 0;
};

// Adds a number to each byte that comes.
class NoisePort final : public FilterPort {
 public:
  NoisePort(const PortContext& context, std::unique_ptr<Port> inner, NoiseOptions options)
      : FilterPort(context, std::move(inner)), options_(options) {}

 private:
  void incoming(ByteView arrival) override {
    Bytes changed(arrival.begin(), arrival.end());
    for (Byte& byte : changed) byte = static_cast<Byte>(byte + options_.added);
    deliver(changed);
  }
  NoiseOptions options_;
};

class WrappedTest : public testing::Test {
 protected:
  WrappedTest() : types({noisy(plain())}) {}

  PortType plain() {
    PortType type{"plain", {"where"}, "a port of this test"};
    type.options = with_common({{"where", OptionSpec::Kind::text, "here", "a place"}});
    type.read = reads([](const PortOptions& written) -> Result<PlainOptions> {
      return PlainOptions{written.text("where")};
    });
    type.make = makes<PlainOptions>([this](const auto&, const auto&, const PlainOptions& options) {
      made_at = options.where;
      return std::make_unique<MemoryPort>(device);
    });
    return type;
  }

  static PortType noisy(PortType type) {
    static const std::array options = {
        OptionSpec{"noise", OptionSpec::Kind::integer, "0", "added to each byte", 0, 100}};
    return wrapped<NoiseOptions>(
        std::move(type), options,
        [](const PortOptions& written) -> Result<std::optional<NoiseOptions>> {
          const long added = written.integer("noise");
          if (added == 13) return make_error(Errc::usage, "not 13");
          if (added == 0) return std::optional<NoiseOptions>();
          return std::optional(NoiseOptions{static_cast<Byte>(added)});
        },
        [](const PortContext& context, std::unique_ptr<Port> port, const NoiseOptions& own) {
          return std::make_unique<NoisePort>(context, std::move(port), own);
        });
  }

  std::string heard(const std::string& spelled) {
    const Result<PortSpec> spec = parse_port(types, spelled);
    EXPECT_TRUE(spec.has_value());
    if (!spec) return {};
    Result<std::unique_ptr<Port>> port = spec->type().make({&loop, book.log()}, *spec, "");
    EXPECT_TRUE(port.has_value());
    if (!port) return {};
    PortLog log;
    (*port)->listen(log);
    (*port)->open();
    device.send("abc");
    return log.data;
  }

  Loop loop;
  LogBook book;
  MemoryPort::Peer device;
  std::string made_at;
  PortTypes types;
};

TEST_F(WrappedTest, TheTypeKeepsItsOptionsAndHasTheWrappers) {
  EXPECT_EQ(heard("plain:there,noise=1"), "bcd");
  EXPECT_EQ(made_at, "there");
  EXPECT_NE(port_help(types).find("added to each byte"), std::string::npos);
}

TEST_F(WrappedTest, WithoutItsOptionsThereIsNoWrapper) { EXPECT_EQ(heard("plain:there"), "abc"); }

TEST_F(WrappedTest, ItsOptionsAreCheckedWhenTheSpecIsRead) {
  EXPECT_FALSE(parse_port(types, "plain:there,noise=13").has_value());
  EXPECT_FALSE(parse_port(types, "plain:there,noise=x").has_value());
}

TEST_F(WrappedTest, WhatEveryPortHasIsReadWithItsOptions) {
  const auto common = [this](const std::string& spelled) { return parse_port(types, spelled)->common(); };
  EXPECT_EQ(common("plain:x").timeout, std::nullopt) << "for ever";
  EXPECT_EQ(common("plain:x,timeout=0").timeout, Nanos{0});
  EXPECT_EQ(common("plain:x,timeout=1.5").timeout, Nanos{1'500'000'000});
  EXPECT_TRUE(common("plain:x").reads);
  EXPECT_TRUE(common("plain:x").writes);
  EXPECT_FALSE(common("plain:x").always_open);
  EXPECT_FALSE(common("plain:x,writeonly").reads);
  EXPECT_FALSE(common("plain:x,readonly").writes);
  EXPECT_TRUE(common("plain:x,alwaysopen").always_open);
}

TEST_F(WrappedTest, TheHelpNamesWhatEveryTypeHasOnce) {
  const std::string help = port_help(types);
  const std::size_t at = help.find("\n  timeout=");
  EXPECT_LT(help.find("\nevery type\n"), at);
  EXPECT_NE(at, std::string::npos);
}

TEST_F(WrappedTest, TheHelpOfATypeThatRecordsAnotherNamesItsOwnOptionsAlone) {
  PortType recorder = plain();
  recorder.name = "plainlog";
  recorder.records = "plain";
  recorder.options.push_back({.name = "tape", .help = "where it goes", .value_name = "FILE"});
  PortType other{"other", {"port"}, "another port"};
  other.options = with_common({{"port", OptionSpec::Kind::text, "here", "a place"}});
  const std::string help = port_help(PortTypes({plain(), recorder, other}));
  EXPECT_NE(help.find("\n  tape=FILE"), std::string::npos) << help;
  EXPECT_NE(help.find("  and the options of plain\n"), std::string::npos) << help;
  EXPECT_NE(help.find("\n  where="), std::string::npos) << help;
  EXPECT_EQ(help.find("\n  where="), help.rfind("\n  where=")) << "the recorded type's, once";
  EXPECT_EQ(help.find("and the options of"), help.rfind("and the options of"));
}

TEST_F(WrappedTest, AFlagIsSpelledWithoutAValue) {
  EXPECT_EQ(parse_options(types, "plain:x,readonly=yes,debug=3")->spelled(), "plain:x,debug=3,readonly");
}

}  // namespace
}  // namespace porttape
