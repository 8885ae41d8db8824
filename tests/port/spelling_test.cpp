// The spellings of ports, with types of this test.

#include "libport/port/spelling.hpp"

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/port/port_options.hpp"
#include "libport/port/port_type.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;
using testing::ElementsAre;

PortTypes types() {
  PortType net{"net", {"ip", "port"}, "a socket"};
  net.listening = {"ip", "port"};
  net.options = {{.name = "ip", .default_value = "127.0.0.1", .value_name = "HOST"},
                 {"port", Kind::integer, "20000", "", 0, 65535},
                 {"listen", Kind::flag},
                 {.name = "mode", .default_value = "0600"},
                 {"seed", Kind::choice, "", "", 0, 0, {"none", "random[:SEED]"}}};
  PortType serial{"serial", {"device"}, "a tty"};
  serial.options = {{.name = "device", .default_value = "/dev/ttyS0", .value_name = "PATH"},
                    {"baud", Kind::integer, "9600"}};
  return PortTypes({net, serial});
}

class Spelling : public testing::Test {
 protected:
  OptionValues values(const std::string& spelled) const {
    const Result<PortOptions> options = parse_options(all, spelled);
    if (!options) return {{"wrong", options.error().message}};
    OptionValues found = options->values;
    found["type"] = options->type->name;
    return found;
  }
  std::string refused(const std::string& spelled) const {
    const Result<PortOptions> options = parse_options(all, spelled);
    if (options) return "nothing is wrong";
    EXPECT_EQ(options.error().code, Errc::usage);
    return options.error().message;
  }

  const PortTypes all = types();
};

TEST_F(Spelling, AHostAndAPortAreOnTheMainPart) {
  using Values = OptionValues;
  EXPECT_EQ(values("net:host"), (Values{{"type", "net"}, {"ip", "host"}}));
  EXPECT_EQ(values("net:host:7"), (Values{{"type", "net"}, {"ip", "host"}, {"port", "7"}}));
  EXPECT_EQ(values("net:[::1]"), (Values{{"type", "net"}, {"ip", "::1"}}));
  EXPECT_EQ(values("net:[::1]:7"), (Values{{"type", "net"}, {"ip", "::1"}, {"port", "7"}}));
  EXPECT_EQ(values("net,port=7"), (Values{{"type", "net"}, {"port", "7"}}));
  EXPECT_EQ(values("net:host,port=7"), (Values{{"type", "net"}, {"ip", "host"}, {"port", "7"}}));
}

TEST_F(Spelling, APortAloneIsForListening) {
  using Values = OptionValues;
  EXPECT_EQ(values("net-listen:7"), (Values{{"type", "net"}, {"listen", "1"}, {"port", "7"}}));
  EXPECT_EQ(values("net-listen:h:7"), (Values{{"type", "net"}, {"listen", "1"}, {"ip", "h"}, {"port", "7"}}));
  EXPECT_EQ(values("net:7"), (Values{{"type", "net"}, {"ip", "7"}})) << "a host's name";
}

TEST_F(Spelling, AnEmptyPartTakesNoDefault) {
  const std::string device =
      "option 'device' is missing; write serial:PATH, or device=/dev/ttyS0 for the default";
  for (const char* const spec : {"serial:", "serial", "serial:,baud=4800", "serial,baud=4800"})
    EXPECT_EQ(refused(spec), std::string("port '") + spec + "': " + device);
  const std::string ip = "option 'ip' is missing; write net:HOST:PORT, or ip=127.0.0.1 for the default";
  for (const char* const spec : {"net:", "net", "net::", "net::7", "net:,mode=0600", "net:,port=7"})
    EXPECT_EQ(refused(spec), std::string("port '") + spec + "': " + ip);
  EXPECT_EQ(refused("net:host:"),
            "port 'net:host:': option 'port' is missing; write net:HOST:PORT, or port=20000 for the default");
  EXPECT_EQ(
      refused("net:[::1]:"),
      "port 'net:[::1]:': option 'port' is missing; write net:HOST:PORT, or port=20000 for the default");
  for (const char* const spec : {"net:[]", "net:[]:7"})
    EXPECT_THAT(refused(spec), testing::HasSubstr("accepted: HOST, HOST:PORT, [IPv6]:PORT")) << spec;
  for (const char* const spec :
       {"net-listen:", "net-listen", "net-listen::", "net-listen::7", "net-listen:10:"})
    EXPECT_THAT(refused(spec), testing::HasSubstr("is missing; write net-listen:HOST:PORT, or ")) << spec;
}

TEST_F(Spelling, AnOptionMayStandInAnEmptyPartsPlace) {
  using Values = OptionValues;
  EXPECT_EQ(values("serial:,device=x"), (Values{{"type", "serial"}, {"device", "x"}}));
  EXPECT_EQ(values("serial,device="), (Values{{"type", "serial"}, {"device", ""}}));
  EXPECT_EQ(values("net::7,ip=h"), (Values{{"type", "net"}, {"ip", "h"}, {"port", "7"}}));
  EXPECT_EQ(values("net:h:,port=7"), (Values{{"type", "net"}, {"ip", "h"}, {"port", "7"}}));
  EXPECT_EQ(values("type=serial"), (Values{{"type", "serial"}})) << "the long spelling has defaults";
}

TEST_F(Spelling, APartWithoutADefaultMayBeEmpty) {
  PortType link{"link", {"path"}, "a link"};
  link.options = {{.name = "path"}};
  const PortTypes types({link});
  for (const char* const spec : {"link:", "link"})
    EXPECT_TRUE(parse_options(types, spec).has_value()) << spec;
}

TEST_F(Spelling, ABarePathIsASerialDevices) {
  EXPECT_EQ(values("/dev/ttyUSB0"), (OptionValues{{"type", "serial"}, {"device", "/dev/ttyUSB0"}}));
  EXPECT_EQ(values("serial:/dev/ttyUSB0"), (OptionValues{{"type", "serial"}, {"device", "/dev/ttyUSB0"}}));
  EXPECT_EQ(values("type=serial,device=x"), (OptionValues{{"type", "serial"}, {"device", "x"}}));
}

TEST_F(Spelling, WhatIsNoPlaceIsRefused) {
  for (const char* const place : {"tcp://host", "::1", "[::1", "[::1]7", "a:b:c", "//host:7"})
    EXPECT_NE(refused(std::string("net:") + place), "nothing is wrong") << place;
  EXPECT_NE(refused("serial-listen:x"), "nothing is wrong") << "it does not listen";
  EXPECT_NE(refused("nett:x"), "nothing is wrong");
}

TEST_F(Spelling, IsTheOneThatIsReadBack) {
  for (const char* const spelled :
       {"net:host:7", "net-listen:host:7", "net:[::1]:7", "serial:/dev/ttyUSB0"}) {
    const Result<PortOptions> options = parse_options(all, spelled);
    ASSERT_TRUE(options.has_value());
    EXPECT_EQ(options->name(), spelled);
    EXPECT_EQ(options->spelled(), spelled);
  }
  const Result<PortOptions> more = parse_options(all, "net:host:7,mode=0660");
  EXPECT_EQ(more->name(), "net:host:7");
  EXPECT_EQ(more->spelled(), "net:host:7,mode=0660");
}

TEST_F(Spelling, NamesATypeOrIsSomethingElse) {
  EXPECT_TRUE(names_type(all, "net:host"));
  EXPECT_TRUE(names_type(all, "net-listen:7"));
  EXPECT_TRUE(names_type(all, "/dev/ttyUSB0"));
  EXPECT_TRUE(names_type(all, "device=x,type=serial"));
  EXPECT_FALSE(names_type(all, "laser.log"));
  EXPECT_FALSE(names_type(all, "serial-listen:x"));
}

TEST_F(Spelling, PermissionsAreOctalAndOfThreeDigits) {
  const auto mode = [this](const std::string& text) -> std::string {
    const Result<unsigned> read = parse_options(all, "net:h,mode=" + text)->mode("mode");
    return read ? std::to_string(*read) : read.error().message;
  };
  EXPECT_EQ(mode("0660"), std::to_string(0660));
  EXPECT_EQ(mode("777"), std::to_string(0777));
  EXPECT_EQ(mode("0777"), std::to_string(0777));
  EXPECT_EQ(mode("0"), "0");
  for (const char* const wrong : {"1000", "00777", "8", "rw", "-1"}) {
    EXPECT_EQ(mode(wrong), std::string("option 'mode': '") + wrong +
                               "' is not valid; accepted: octal permissions like 0660");
  }
}

TEST_F(Spelling, ANumberMayStandBehindAChoiceThatHasOne) {
  EXPECT_EQ(values("net:h,seed=random:7")["seed"], "random:7");
  EXPECT_EQ(values("net:h,seed=random")["seed"], "random");
  for (const char* const wrong : {"random:", "random:x", "random:4294967296", "none:7", "randomly"}) {
    EXPECT_THAT(refused(std::string("net:h,seed=") + wrong), testing::HasSubstr("'seed'")) << wrong;
  }
}

TEST(SplitTokens, LeavesOutWhatIsEmpty) {
  EXPECT_THAT(split_tokens("a,b;c", ",;"), ElementsAre("a", "b", "c"));
  EXPECT_THAT(split_tokens(",,a,", ","), ElementsAre("a"));
  EXPECT_THAT(split_tokens("", ","), testing::IsEmpty());
  EXPECT_EQ(split_option("key=a=b"), (std::pair<std::string, std::string>("key", "a=b")));
  EXPECT_EQ(split_option("flag"), (std::pair<std::string, std::string>("flag", "1")));
  EXPECT_EQ(split_option("key="), (std::pair<std::string, std::string>("key", "")));
}

TEST_F(Spelling, APortIsOfDigitsFromNoughtToNine) {
  EXPECT_EQ(values("net-listen:1090")["port"], "1090");
  EXPECT_EQ(values("net-listen:10/0")["wrong"], refused("net-listen:10/0"));
  EXPECT_EQ(values("net-listen:10:1")["ip"], "10");
  EXPECT_EQ(values("net-listen:1a")["ip"], "1a");
}

TEST_F(Spelling, ATypeByItsOtherNameIsAnsweredWithOurs) {
  EXPECT_THAT(refused("tty:/dev/ttyUSB0"), testing::EndsWith("unknown type 'tty'; did you mean 'serial'?"));
  EXPECT_THAT(refused("seriel:/dev/ttyUSB0"), testing::EndsWith("; did you mean 'serial'?"));
  EXPECT_THAT(refused("elephant:x"), testing::EndsWith("unknown type 'elephant'; accepted: net, serial"));
  EXPECT_THAT(refused("elephant-listen:7"),
              testing::EndsWith("unknown type 'elephant-listen'; accepted: net, serial"));
  EXPECT_FALSE(names_type(all, "elephant-listen:7"));
  EXPECT_EQ(refused("type=,port=7"), "port 'type=,port=7': option 'type' is missing; accepted: net, serial");
  EXPECT_THAT(refused(" , "), testing::StartsWith("a port is missing; name one as TYPE:MAIN"));
}

TEST_F(Spelling, FlagsAreSpelledWithoutAValueAndAMainPartThatIsMissingIsLeftOut) {
  const auto spelled = [this](const std::string& text) { return parse_options(all, text)->spelled(); };
  EXPECT_EQ(spelled("type=net,ip=h,port=7,listen"), "net-listen:h:7");
  EXPECT_EQ(spelled("type=net,ip=h"), "net:h:20000");
  EXPECT_EQ(spelled("type=net"), "net:127.0.0.1:20000");
  EXPECT_EQ(spelled("net:h,listen=off"), "net:h:20000");
}

TEST_F(Spelling, AnAddressWithoutBracketsIsAnsweredWithTheForm) {
  EXPECT_THAT(refused("net:a:b:c"), testing::HasSubstr("accepted: HOST, HOST:PORT, [IPv6]:PORT"));
}

TEST_F(Spelling, AnOptionThatHasNoNumberIsNought) {
  EXPECT_EQ(parse_options(all, "net:h")->number("seed"), 0);
}

}  // namespace
}  // namespace porttape
