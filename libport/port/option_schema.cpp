#include "libport/port/option_schema.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <string>

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

constexpr double kMaxBaud = 4'294'967'295.0;  // termios2 keeps speeds in 32 bits
constexpr double kMaxSeconds = 1e9;
constexpr double kMaxPort = 65535;  // 0 is for the listening ones: check_port() sees to that

const OptionSpec kWait{"wait", Kind::flag, "", "a device that is missing is waited for"};

std::vector<OptionSpec> with_common(std::vector<OptionSpec> options) {
  const std::vector<OptionSpec> common = {
      {"debug", Kind::integer, "0", "verbosity of the port, 0 to 9", 0, 9},
      {"timeout", Kind::number, "-1", "seconds that a blocking read or write waits, -1 for ever", -1,
       kMaxSeconds},
      {"readonly", Kind::flag, "", "bytes come from the peer, none go to it"},
      {"writeonly", Kind::flag, "", "bytes go to the peer, none come from it"},
      {"readwrite", Kind::flag, "", "both ways (the default)"},
      {"alwaysopen", Kind::flag, "", "stays open while no driver has the other end open"},
  };
  options.insert(options.end(), common.begin(), common.end());
  return options;
}

PortType serial_type() {
  return {"serial",
          {"device"},
          with_common({
              {"device", Kind::text, "/dev/ttyS0", "the tty"},
              {"baud", Kind::integer, "9600", "bit/s, any rate the kernel takes", 1, kMaxBaud},
              {"parity", Kind::choice, "none", "none, even or odd", 0, 0, {"none", "even", "odd"}},
              {"databits", Kind::integer, "8", "5 to 8", 5, 8},
              {"stopbits", Kind::integer, "1", "1 or 2", 1, 2},
              {"hwflowctrl", Kind::flag, "", "RTS/CTS flow control"},
              {"swflowctrl", Kind::flag, "", "XON/XOFF flow control"},
              {"dtr", Kind::choice, "", "sets DTR after opening", 0, 0, {"on", "off"}},
              {"rts", Kind::choice, "", "sets RTS after opening", 0, 0, {"on", "off"}},
              kWait,
          }),
          "a serial device"};
}

PortType pty_type() {
  return {"pty",
          {"link"},
          with_common({
              {"link", Kind::text, "", "symbolic link to the slave; without it the slave's path is printed"},
              {"mode", Kind::text, "0600", "permissions of the slave, octal"},
              {"owner", Kind::text, "", "owner of the slave, name or number"},
              {"group", Kind::text, "", "group of the slave, name or number"},
          }),
          "a pseudo-terminal that the peer opens"};
}

PortType tcp_type() {
  return {"tcp",
          {"ip", "port"},
          with_common({
              {"ip", Kind::text, "127.0.0.1",
               "address or name of the peer; with listen the own address, * for all"},
              {"port", Kind::integer, "20000", "1 to 65535; with listen 0 takes a free one and prints it", 0,
               kMaxPort},
              {"listen", Kind::flag, "", "the peer connects (tcp-listen:)"},
              kWait,
          }),
          "a TCP connection",
          {"ip", "port"}};
}

PortType udp_type() {
  return {
      "udp",
      {"dest_ip", "dest_port"},
      with_common({
          {"dest_ip", Kind::text, "127.0.0.1", "address or name that datagrams go to"},
          {"dest_port", Kind::integer, "20000", "1 to 65535", 1, kMaxPort},
          {"recv_ip", Kind::text, "*", "own address, * for all (with listen 127.0.0.1 unless given)"},
          {"recv_port", Kind::integer, "20000", "1 to 65535, 0 takes a free one and prints it", 0, kMaxPort},
          {"listen", Kind::flag, "", "datagrams go to who sent the latest one (udp-listen:)"},
          {"from",
           Kind::choice,
           "",
           "whose datagrams count: the peer's, or anybody's (default: peer; with listen, and in a program's "
           "own ports, any)",
           0,
           0,
           {"peer", "any"}},
      }),
      "UDP datagrams",
      {"recv_ip", "recv_port"}};
}

PortType unix_type() {
  return {"unix",
          {"path"},
          with_common({
              {"path", Kind::text, "", "the socket file"},
              {"listen", Kind::flag, "", "the peer connects (unix-listen:)"},
              {"mode", Kind::text, "0600", "permissions of the socket file, octal; with listen"},
              kWait,
          }),
          "a Unix stream socket",
          {"path"}};
}

PortType logreader_type() {
  return {"logreader",
          {"file"},
          with_common({
              {"file", Kind::text, "port.log", "the tape: FILEr, FILEw, FILEe"},
              {"strictness", Kind::integer, "0", "0 writes not checked, 1 data, 2 data and timing", 0, 2},
              {"jitter", Kind::number, "100", "ms, margin of strictness 2, early and late", 0, kMaxSeconds},
              {"early-only", Kind::flag, "",
               "strictness 2 accepts late writes, as flexiport's documentation does"},
              {"ignoretimes", Kind::flag, "", "the same as timing=none"},
              {"timing",
               Kind::choice,
               "recorded",
               "when bytes become readable",
               0,
               0,
               {"reactive", "recorded", "none"}},
              {"rate", Kind::number, "1", "time runs this many times as fast", 1e-6, 1e6},
              {"on-mismatch", Kind::choice, "warn", "what a wrong write does", 0, 0, {"fail", "warn"}},
              {"at-end",
               Kind::choice,
               "idle",
               "what the used-up tape does (exit by --once on udp)",
               0,
               0,
               {"idle", "hangup", "exit"}},
              {"on-reopen",
               Kind::choice,
               "auto",
               "what a second open does",
               0,
               0,
               {"auto", "rewind", "continue"}},
              {"chunks",
               Kind::choice,
               "auto",
               "how bytes are cut into arrivals",
               0,
               0,
               {"auto", "recorded", "burst"}},
              {"burst-gap", Kind::integer, "500", "µs, reads closer than this are one burst", 0, 1e9},
              {"patience", Kind::number, "1", "s, strictness 0 waits this long for a write", 0, kMaxSeconds},
              {"once", Kind::flag, "", "the program ends after the first run, with its verdict"},
              {"report", Kind::text, "", "file for the verdict as JSON"},
          }),
          "a tape in the device's place"};
}

// The type that records `inner`: its options and those of the tape.
PortType recording_type(const PortType& inner, std::string_view name) {
  PortType type{name, inner.form, inner.options, "a port with a tape of it", inner.listening};
  const std::vector<OptionSpec> tape = {
      {"file", Kind::text, "port.log", "the tape: FILEr, FILEw, FILEe"},
      {"on-existing",
       Kind::choice,
       "refuse",
       "a tape of that name is there: an error, the next free name (laser.2.log), or it is replaced",
       0,
       0,
       {"refuse", "next", "overwrite"}},
      {"overwrite", Kind::flag, "", "the same as on-existing=overwrite"},
      {"failclosed", Kind::flag, "", "ends when the tape cannot be written; else the line stays up"},
  };
  type.options.insert(type.options.begin(), tape.begin(), tape.end());
  return type;
}

const std::vector<PortType>& types() {
  static const std::vector<PortType> all = {
      serial_type(),
      pty_type(),
      logreader_type(),
      tcp_type(),
      udp_type(),
      unix_type(),
      recording_type(serial_type(), "seriallog"),
      recording_type(pty_type(), "ptylog"),
      recording_type(tcp_type(), "tcplog"),
      recording_type(udp_type(), "udplog"),
      recording_type(unix_type(), "unixlog"),
  };
  return all;
}

Error bad_value(const OptionSpec& option, std::string_view value, std::string_view accepted) {
  return make_error(
      Errc::usage, fmt::format("option '{}': '{}' is not valid; accepted: {}", option.name, value, accepted));
}

Result<std::string> check_flag(const OptionSpec& option, std::string_view value) {
  constexpr std::array<std::string_view, 4> on = {"1", "on", "yes", "true"};
  constexpr std::array<std::string_view, 4> off = {"0", "off", "no", "false"};
  if (std::ranges::find(on, value) != on.end()) return std::string("1");
  if (std::ranges::find(off, value) != off.end()) return std::string();
  return bad_value(option, value, "on, off");
}

Result<std::string> check_number(const OptionSpec& option, std::string_view value) {
  double number = 0;
  const auto [end, error] =
      std::from_chars(value.data(), value.data() + value.size(), number, std::chars_format::fixed);
  const bool whole = option.kind != Kind::integer || std::floor(number) == number;
  if (error != std::errc{} || end != value.data() + value.size() || !std::isfinite(number) || !whole ||
      number < option.min || number > option.max) {
    return bad_value(option, value,
                     fmt::format("a {}number from {} to {}", option.kind == Kind::integer ? "whole " : "",
                                 option.min, option.max));
  }
  return std::string(value);
}

}  // namespace

const OptionSpec* PortType::find(std::string_view option) const {
  const auto it = std::ranges::find(options, option, &OptionSpec::name);
  return it == options.end() ? nullptr : &*it;
}

std::span<const PortType> port_types() { return types(); }

const PortType* find_port_type(std::string_view name) {
  const auto it = std::ranges::find(types(), name, &PortType::name);
  return it == types().end() ? nullptr : &*it;
}

Result<std::string> check_value(const OptionSpec& option, std::string_view value) {
  switch (option.kind) {
    case Kind::text:
      break;
    case Kind::flag:
      return check_flag(option, value);
    case Kind::integer:
    case Kind::number:
      return check_number(option, value);
    case Kind::choice:
      if (std::ranges::find(option.choices, value) == option.choices.end()) {
        return bad_value(option, value, fmt::format("{}", fmt::join(option.choices, ", ")));
      }
      break;
  }
  return std::string(value);
}

}  // namespace porttape
