#include "libport/catalog/port_types.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

PortOptions parsed(std::string_view spec) {
  const Result<PortSpec> port = parse_port(spec);
  EXPECT_TRUE(port.has_value()) << (port ? "" : port.error().message);
  return port ? port->written() : PortOptions{};
}

std::string error_of(std::string_view spec) {
  const Result<PortSpec> options = parse_port(spec);
  EXPECT_FALSE(options.has_value()) << spec;
  if (options) return {};
  EXPECT_EQ(options.error().code, Errc::usage);
  return options.error().message;
}

TEST(PortOptions, BothSpellingsMeanTheSame) {
  EXPECT_EQ(parsed("type=serial,device=/dev/ttyUSB0,baud=115200"), parsed("serial:/dev/ttyUSB0,baud=115200"));
  EXPECT_EQ(parsed("/dev/ttyUSB0"), parsed("serial:/dev/ttyUSB0"));
}

TEST(PortOptions, SeparatorsAreFlexiports) {
  EXPECT_EQ(parsed("type=serial device=/dev/x\tbaud=1200\nhwflowctrl"),
            parsed("serial:/dev/x,baud=1200,hwflowctrl"));
  EXPECT_EQ(parsed(",,type=serial,,device=/dev/x,"), parsed("serial:/dev/x"));
}

TEST(PortOptions, DefaultsAreFlexiports) {
  const PortOptions serial = parsed("type=serial");
  EXPECT_EQ(serial.text("device"), "/dev/ttyS0");
  EXPECT_EQ(serial.integer("baud"), 9600);
  EXPECT_EQ(serial.text("parity"), "none");
  EXPECT_EQ(serial.number("timeout"), -1.0);
  EXPECT_FALSE(serial.flag("alwaysopen"));
  const PortOptions reader = parsed("type=logreader,file=x");
  EXPECT_EQ(reader.integer("strictness"), 0);
  EXPECT_EQ(reader.text("timing"), "recorded");
}

TEST(PortOptions, TheLastOfEqualOptionsCounts) {
  EXPECT_EQ(parsed("serial:/dev/x,baud=1200,baud=2400").integer("baud"), 2400);
}

TEST(PortOptions, ABareWordTurnsABooleanOnAndOffTurnsItOff) {
  EXPECT_TRUE(parsed("serial:/dev/x,alwaysopen").flag("alwaysopen"));
  EXPECT_TRUE(parsed("serial:/dev/x,alwaysopen=on").flag("alwaysopen"));
  EXPECT_FALSE(parsed("serial:/dev/x,alwaysopen=0").flag("alwaysopen"));
}

TEST(PortOptions, ErrorsNameOptionValueAndWhatIsAccepted) {
  EXPECT_NE(error_of("serial:/dev/x,baud=fast").find("'baud': 'fast'"), std::string::npos);
  EXPECT_NE(error_of("serial:/dev/x,parity=mark").find("none, even, odd"), std::string::npos);
  EXPECT_NE(error_of("serial:/dev/x,speed=9").find("unknown option 'speed'"), std::string::npos);
  EXPECT_NE(error_of("modem:/dev/x").find("unknown type 'modem'"), std::string::npos);
  EXPECT_NE(error_of("serial:/dev/x,bau=9").find("of type serial; did you mean 'baud'?"), std::string::npos);
  EXPECT_NE(error_of("serail:/dev/x").find("did you mean 'serial'?"), std::string::npos);
  EXPECT_NE(error_of("TCP-LISTEN:5").find("did you mean 'tcp-listen'?"), std::string::npos);
  EXPECT_NE(error_of("tty:/dev/x").find("did you mean 'serial'?"), std::string::npos);
  EXPECT_NE(error_of("tcp://host:5").find("HOST:PORT"), std::string::npos);
  EXPECT_NE(error_of("").find("missing"), std::string::npos);
  EXPECT_NE(error_of("type=tcplog,port=5,file=").find("'file' is empty"), std::string::npos);
}

TEST(PortOptions, NumbersAreCheckedToTheLastCharacter) {
  for (const char* bad :
       {"baud=0", "baud=-1", "baud=9600x", "baud=", "baud=1.5", "baud=4294967296", "databits=9", "databits=4",
        "stopbits=3", "timeout=-2", "timeout=nan", "timeout=inf"}) {
    EXPECT_FALSE(parse_port(std::string("serial:/dev/x,") + bad).has_value()) << bad;
  }
  EXPECT_EQ(parsed("serial:/dev/x,baud=12000000").integer("baud"), 12'000'000);
  EXPECT_DOUBLE_EQ(parsed("serial:/dev/x,timeout=.5").number("timeout"), 0.5);
}

TEST(PortOptions, NameIsTheShortSpellingOfTheMainPart) {
  EXPECT_EQ(parsed("type=serial,device=/dev/ttyUSB0,baud=1200").name(), "serial:/dev/ttyUSB0");
  EXPECT_EQ(parsed("pty").name(), "pty");
}

TEST(PortOptions, PlacesOfSocketsInEverySpelling) {
  EXPECT_EQ(parsed("tcp:10.0.0.5:2112"), parsed("type=tcp,ip=10.0.0.5,port=2112"));
  EXPECT_EQ(parsed("tcp:[::1]:2112"), parsed("type=tcp,ip=::1,port=2112"));
  EXPECT_EQ(parsed("tcp:[::1]"), parsed("type=tcp,ip=::1"));
  EXPECT_EQ(parsed("tcp:laser.example"), parsed("type=tcp,ip=laser.example"));
  EXPECT_EQ(parsed("tcp-listen:127.0.0.1:2112"), parsed("type=tcp,listen,ip=127.0.0.1,port=2112"));
  EXPECT_EQ(parsed("tcp-listen:2112,timeout=3"), parsed("type=tcp,listen,port=2112,timeout=3"));
  EXPECT_EQ(parsed("tcp-listen:*:2112"), parsed("type=tcp,listen,ip=*,port=2112"));
  EXPECT_EQ(parsed("udp:127.0.0.1:2112"), parsed("type=udp,dest_ip=127.0.0.1,dest_port=2112"));
  EXPECT_EQ(parsed("udp-listen:2112"), parsed("type=udp,listen,recv_ip=127.0.0.1,recv_port=2112"));
  EXPECT_EQ(parsed("unix:/run/x"), parsed("type=unix,path=/run/x"));
  EXPECT_EQ(parsed("unix-listen:/run/x,mode=0660"), parsed("type=unix,listen,path=/run/x,mode=0660"));
  EXPECT_EQ(parsed("tcplog:h:1,file=x"), parsed("type=tcplog,ip=h,port=1,file=x"));
}

TEST(PortOptions, NamesOfSocketsCanBeParsedAgain) {
  for (const char* spec :
       {"tcp:10.0.0.5:2112", "tcp:[::1]:2112", "tcp-listen:127.0.0.1:2112", "tcp-listen:*:0",
        "udp:127.0.0.1:2112", "udp-listen:127.0.0.1:2112", "unix:/run/x", "unix-listen:/run/x"}) {
    EXPECT_EQ(parsed(spec).name(), spec);
  }
  EXPECT_EQ(parsed("type=tcp").name(), "tcp:127.0.0.1:20000");
}

TEST(PortOptions, EveryOptionThatWasGivenIsSpelledAndCanBeParsedAgain) {
  for (const char* spec :
       {"serial:/dev/ttyUSB0,baud=115200,hwflowctrl,parity=even", "serial:/dev/ttyS0", "pty,mode=0660",
        "pty:/tmp/laser,alwaysopen", "tcp:[::1]:2112,timeout=1.5", "tcp-listen:*:0,alwaysopen",
        "udp:10.0.0.5:2112,recv_port=7", "udp-listen:127.0.0.1:2112,dest_ip=10.0.0.5",
        "seriallog:/dev/ttyUSB0,file=a b,overwrite", "logreader:x.log,jitter=5,strictness=2"}) {
    EXPECT_EQ(parsed(spec).spelled(), spec);
    EXPECT_EQ(parsed(parsed(spec).spelled()).spelled(), spec);
  }
  EXPECT_EQ(parsed("type=tcp,listen,port=7,debug=1").spelled(), "tcp-listen:127.0.0.1:7,debug=1");
}

TEST(PortOptions, AnEmptyMainPartTakesNoOtherOptionWithIt) {
  constexpr const char* spec = "serial,baud=300,device=";
  EXPECT_EQ(parsed(spec).spelled(), spec);
  EXPECT_EQ(parsed(parsed(spec).spelled()), parsed(spec));
}

TEST(PortOptions, BadPlacesOfSocketsAreNamed) {
  for (const char* bad :
       {"tcp:::1:2112", "tcp:[::1", "tcp:[::1]x", "tcp:h:65536", "tcp:h:0", "tcp:h:-1", "tcp:h:x", "udp:h:0",
        "unix", "pty-listen:/x", "tcp-listening:1", "pty:/x,mode=rw", "pty:/x,mode=01777"}) {
    EXPECT_FALSE(parse_port(bad).has_value()) << bad;
  }
  EXPECT_NE(error_of("tcp:h:70000").find("'port': '70000'"), std::string::npos);
  EXPECT_NE(error_of("unix:/" + std::string(120, 'x')).find("at most 107"), std::string::npos);
}

// What an empty variable of a shell leaves of `serial:$DEV`. The types whose main part has no default keep
// it: a pty that is empty makes a name of its own, a Unix socket's path was missing anyway.
TEST(PortOptions, AnEmptyPartIsNoPlaceThatNobodyNamed) {
  for (const std::string& type : port_types().spellings()) {
    const bool is_pty = type.starts_with("pty");
    for (const char* const rest : {"", ":", ":,alwaysopen", ",alwaysopen"}) {
      const std::string file = type.ends_with("log") ? ",file=x" : "";
      EXPECT_EQ(parse_port(type + rest + file).has_value(), is_pty) << type << rest << file;
    }
  }
  EXPECT_EQ(
      error_of("serial:"),
      "port 'serial:': option 'device' is missing; write serial:PATH, or device=/dev/ttyS0 for the default");
  EXPECT_EQ(error_of("udp-listen:"),
            "port 'udp-listen:': option 'recv_ip' is missing; write "
            "udp-listen:HOST:PORT, or recv_ip=* for the default");
  EXPECT_EQ(
      error_of("logreader:"),
      "port 'logreader:': option 'file' is missing; write logreader:NAME, or file=port.log for the default");
  EXPECT_EQ(error_of("unix:"), "port 'unix:': option 'path' is missing; accepted: the path of a socket");
}

TEST(PortOptions, HelpNamesEveryType) {
  for (const char* type : {"tcp:ip:port", "tcp-listen:ip:port", "udplog", "unix-listen:path", "serial:device",
                           "pty:link", "logreader:file", "seriallog"}) {
    EXPECT_NE(port_help(port_types()).find(type), std::string::npos) << type;
  }
}

}  // namespace
}  // namespace porttape
