#include "tests/infer/sessions.hpp"

#include <bit>
#include <fmt/format.h>
#include <random>
#include <string>

namespace porttape::test {
namespace {

// The session while it is written: time, chance, the tape.
class Script {
 public:
  explicit Script(const SessionShape& shape) : shape_(shape), random_(shape.seed * 7919 + 13) {}

  // A number in [0, n).
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(random_() % n); }
  std::uint32_t polls(std::uint32_t usual) {
    const std::uint32_t more = below(usual + 3);
    return shape_.free_polls ? 1 + more : usual;
  }
  Script& write(std::string_view bytes) {
    now_ += 20'000 + below(3'000);
    tape_.write(now_, bytes);
    return *this;
  }
  Script& answer(std::string_view bytes) {
    if (shape_.answers) tape_.read(now_ += 2'000 + below(500), bytes);
    return *this;
  }
  MemoryTape done() { return std::move(tape_); }

 private:
  SessionShape shape_;
  std::mt19937 random_;
  std::int64_t now_ = 1'000;
  MemoryTape tape_;
};

std::string little(std::uint64_t value, std::size_t size) {
  std::string out;
  for (std::size_t i = 0; i < size; ++i) out += static_cast<char>(value >> (8 * i));
  return out;
}
std::string big(std::uint64_t value, std::size_t size) {
  const std::string out = little(value, size);
  return {out.rbegin(), out.rend()};
}
std::string real(float value) { return little(std::bit_cast<std::uint32_t>(value), 4); }

unsigned byte_of(char character) { return static_cast<unsigned char>(character); }

std::uint32_t crc16_reflected(std::string_view bytes, std::uint32_t crc, std::uint32_t polynomial) {
  for (const char byte : bytes) {
    crc ^= byte_of(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ polynomial : crc >> 1U;
  }
  return crc;
}

// Modbus.

std::string rtu(const std::string& frame) {
  return frame + little(crc16_reflected(frame, 0xffff, 0xa001), 2);
}

std::string read_registers(char function, std::uint32_t first, std::uint32_t count) {
  return std::string{'\x11', function} + big(first, 2) + big(count, 2);
}

std::string registers(Script& script, char function, std::uint32_t count) {
  std::string answer = std::string{'\x11', function} + big(2 * count, 1);
  for (std::uint32_t i = 0; i < count; ++i) answer += big(script.below(65536), 2);
  return answer;
}

// NMEA.

std::string sentence(const std::string& body) {
  unsigned sum = 0;
  for (const char byte : body) sum ^= byte_of(byte);
  return "$" + body + fmt::format("*{:02X}\r\n", sum);
}

// UBX.

std::string ubx(unsigned group, unsigned id, const std::string& payload) {
  const std::string body = little(group, 1) + little(id, 1) + little(payload.size(), 2) + payload;
  unsigned a = 0;
  unsigned b = 0;
  for (const char byte : body) {
    a = (a + byte_of(byte)) & 0xffU;
    b = (b + a) & 0xffU;
  }
  return "\xb5\x62" + body + little(a, 1) + little(b, 1);
}

// SCIP 2.

std::string scip_sum(const std::string& line) {
  unsigned sum = 0;
  for (const char byte : line) sum += byte_of(byte);
  return line + static_cast<char>((sum & 0x3fU) + 0x30) + "\n";
}

// MAVLink.

struct Message {
  unsigned id = 0;
  unsigned extra = 0;
  std::string payload;
};

class MavlinkSender {
 public:
  MavlinkSender(int version, unsigned system, unsigned sequence)
      : version_(version), system_(system), sequence_(sequence) {}

  std::string frame(const Message& message) {
    std::string payload = message.payload;
    if (version_ == 2)
      while (payload.size() > 1 && payload.back() == '\0') payload.pop_back();
    std::string body = little(payload.size(), 1);
    if (version_ == 2) body += std::string(2, '\0');
    body += little(sequence_++ & 0xffU, 1) + little(system_, 1) + little(190, 1);
    body += little(message.id, version_ == 2 ? 3 : 1) + payload;
    const std::string extra = little(message.extra, 1);
    return (version_ == 2 ? "\xfd" : "\xfe") + body +
           little(crc16_reflected(body + extra, 0xffff, 0x8408), 2);
  }

 private:
  int version_;
  unsigned system_;
  unsigned sequence_;
};

Message heartbeat() { return {0, 50, little(0, 4) + "\x06\x08" + little(192, 1) + "\x04\x03"}; }

Message command_long(Script& script, unsigned command) {
  std::string payload;
  for (int i = 0; i < 7; ++i)
    payload += real(i < 3 ? static_cast<float>(script.below(2000)) / 8.0F + 1.0F : 0.0F);
  return {76, 152, payload + little(command, 2) + "\x01" + "\x01" + little(0, 1)};
}

Message system_time(Script& script) {
  return {2, 137,
          little(1'700'000'000'000'000 + std::uint64_t{script.below(1U << 31U)} * 1000, 8) +
              little(script.below(1U << 30U), 4)};
}

Message param_request_read(const std::string& name) {
  std::string padded = name;
  padded.resize(16, '\0');
  return {20, 214, little(0xffff, 2) + "\x01\x01" + padded};
}

Message command_ack(unsigned command) { return {77, 143, little(command, 2) + little(0, 1)}; }

MemoryTape mavlink_session(const SessionShape& shape, int version) {
  Script script(shape);
  MavlinkSender driver(version, 255, script.below(256));
  MavlinkSender device(version, 1, script.below(256));
  script.write(driver.frame(heartbeat())).answer(device.frame(heartbeat()));
  for (const char* name : {"SYSID_THISMAV", "FS_GCS_ENABLE", "RC_MAP_ROLL"})
    script.write(driver.frame(param_request_read(name)));
  script.write(driver.frame(system_time(script)));
  for (int round = 0; round < 6; ++round) {
    const unsigned command = round % 2 == 0 ? 400 : 511;
    for (std::uint32_t i = script.polls(2); i > 0; --i) script.write(driver.frame(heartbeat()));
    script.write(driver.frame(command_long(script, command))).answer(device.frame(command_ack(command)));
  }
  script.write(driver.frame(system_time(script)));
  return script.done();
}

// gdb's remote protocol.

std::string packet(const std::string& body) {
  unsigned sum = 0;
  for (const char byte : body) sum += byte_of(byte);
  return "$" + body + fmt::format("#{:02x}", sum & 0xffU);
}

std::string memory(Script& script, std::uint32_t size) {
  std::string out;
  for (std::uint32_t i = 0; i < size; ++i) out += fmt::format("{:02x}", script.below(256));
  return out;
}

}  // namespace

MemoryTape modbus_rtu_session(const SessionShape& shape) {
  Script script(shape);
  const auto ask = [&](const std::string& request, const std::string& answer) {
    script.write(rtu(request)).answer(rtu(answer));
  };
  ask(read_registers(3, 0, 10), registers(script, 3, 10));
  for (std::uint32_t round = 0; round < 6; ++round) {
    for (std::uint32_t i = script.polls(3); i > 0; --i)
      ask(read_registers(4, 0x10, 4), registers(script, 4, 4));
    const std::string set =
        std::string("\x11\x06") + big(0x20 + (round % 2), 2) + big(script.below(65536), 2);
    ask(set, set);
    const std::string head = std::string("\x11\x10") + big(0x30, 2) + big(2, 2);
    ask(head + "\x04" + big(script.below(65536), 2) + big(script.below(65536), 2), head);
  }
  return script.done();
}

MemoryTape modbus_tcp_session(const SessionShape& shape) {
  Script script(shape);
  std::uint32_t id = script.below(60'000);
  const auto ask = [&](const std::string& request, const std::string& answer) {
    script.write(big(id, 2) + big(0, 2) + big(request.size(), 2) + request);
    script.answer(big(id, 2) + big(0, 2) + big(answer.size(), 2) + answer);
    ++id;
  };
  for (int round = 0; round < 8; ++round) {
    for (std::uint32_t i = script.polls(3); i > 0; --i)
      ask(read_registers(4, 0x10, 4), registers(script, 4, 4));
    const std::string set = std::string("\x11\x06") + big(0x20, 2) + big(script.below(65536), 2);
    ask(set, set);
    const std::string head = std::string("\x11\x10") + big(0x30, 2) + big(1, 2);
    ask(head + "\x02" + big(script.below(65536), 2), head);
  }
  return script.done();
}

MemoryTape nmea_session(const SessionShape& shape) {
  Script script(shape);
  std::uint32_t number = script.below(95);
  script.write(sentence("PMTK314,0,1,0,1,1,5,0,0,0,0,0,0,0,0,0,0,0,0,0")).answer(sentence("PMTK001,314,3"));
  script.write(sentence("PMTK220,200")).answer(sentence("PMTK001,220,3"));
  script.write(sentence(fmt::format("PMTK741,{:.6f},{:.6f},{},2026,11,{},{},{},{}",
                                    24.0 + script.below(9'000) / 1000.0, 99.5 + script.below(2'000'000) / 1e6,
                                    20 + script.below(900), script.below(28) + 1, script.below(24),
                                    script.below(60), script.below(60))));
  for (int round = 0; round < 9; ++round) {
    script.write(sentence(fmt::format("PTIM,{:02}{:02}{:02}.{:02},221126", script.below(24), script.below(60),
                                      script.below(60), script.below(100))));
    for (std::uint32_t i = script.polls(2); i > 0; --i)
      script.write(sentence("PQTXT,VER")).answer(sentence("PQTXT,VER,1.2"));
    script.write(sentence(fmt::format("PABC,SEQ,{},OK", number)))
        .answer(sentence(fmt::format("PABC,ACK,{}", number)));
    ++number;
  }
  return script.done();
}

MemoryTape ubx_session(const SessionShape& shape) {
  Script script(shape);
  script.write(ubx(0x0a, 0x04, "")).answer(ubx(0x0a, 0x04, std::string(40, 'v')));
  script.write(ubx(0x06, 0x08, little(200, 2) + little(1, 2) + little(1, 2)));
  for (int round = 0; round < 5; ++round) {
    const std::string now = little(2026, 2) + little(1 + script.below(12), 1) +
                            little(1 + script.below(28), 1) + little(script.below(24), 1) +
                            little(script.below(60), 1) + little(script.below(60), 1) + little(0, 1) +
                            little(script.below(1'000'000'000), 4);
    script.write(ubx(0x13, 0x40,
                     std::string("\x10\0\0\x80", 4) + now + little(2, 2) + little(0, 2) +
                         little(script.below(100'000), 4)));
    std::string values = std::string("\0\x01\0\0", 4);
    for (std::uint32_t i = 1 + script.below(3); i > 0; --i)
      values += little(0x30210001 + i, 4) + little(script.below(65536), 2);
    script.write(ubx(0x06, 0x8a, values)).answer(ubx(0x05, 0x01, "\x06\x8a"));
    for (std::uint32_t i = script.polls(2); i > 0; --i)
      script.write(ubx(0x01, 0x07, "")).answer(ubx(0x01, 0x07, std::string(92, 'p')));
    script.write(ubx(0x06, 0x01, "\xf0" + little(script.below(6), 1) + little(1, 1)));
  }
  return script.done();
}

MemoryTape scip_session(const SessionShape& shape) {
  Script script(shape);
  const auto ask = [&](const std::string& command, const std::string& status) {
    script.write(command + "\n").answer(command + "\n" + scip_sum(status) + "\n");
  };
  ask("VV", "00");
  ask("PP", "00");
  ask("BM", "00");
  for (int round = 0; round < 4; ++round) {
    ask("TM0", "00");
    ask("TM2", "00");
    for (std::uint32_t i = script.polls(2); i > 0; --i) ask("GD0044072501", "00");
    ask(fmt::format("MD0044072501{}{:02};run-{}", static_cast<char>('0' + round), 3U,
                    script.below(shape.seed % 2 == 0 ? 100'000 : 1'000)),
        "00");
  }
  ask("QT", "00");
  return script.done();
}

MemoryTape mavlink1_session(const SessionShape& shape) { return mavlink_session(shape, 1); }
MemoryTape mavlink2_session(const SessionShape& shape) { return mavlink_session(shape, 2); }

MemoryTape gdb_session(const SessionShape& shape) {
  Script script(shape);
  const std::uint64_t base = 0x555500000000ULL + (std::uint64_t{script.below(1U << 20U)} << 12U);
  const unsigned process = 300 + script.below(60'000);
  const auto ask = [&](const std::string& body, const std::string& answer) {
    script.write(packet(body)).answer("+" + packet(answer));
    script.write("+");
  };
  script.write("+");
  ask("qSupported:multiprocess+;swbreak+;hwbreak+;qRelocInsn+;fork-events+", "PacketSize=47ff;multiprocess+");
  ask("vMustReplyEmpty", "");
  ask("?", fmt::format("T05thread:p{:x}.{:x};core:1;", process, process));
  ask(fmt::format("Hgp{:x}.{:x}", process, process), "OK");
  ask("g", memory(script, 24));
  for (int round = 0; round < 5; ++round) {
    for (std::uint32_t i = script.polls(2); i > 0; --i) ask("qfThreadInfo", "l");
    ask(fmt::format("m{:x},40", base + script.below(0x10000)), memory(script, 64));
    ask(fmt::format("Z0,{:x},1", base + 0x1139), "OK");
    ask(fmt::format("X{:x},4:", static_cast<unsigned long long>(base + script.below(0x1000))) + "}\x03}\x04" +
            "ab",
        "OK");
    ask(fmt::format("vCont;c:p{:x}.-1", process),
        fmt::format("T05swbreak:;thread:p{:x}.{:x};", process, process));
  }
  ask(fmt::format("D;{:x}", process), "OK");
  return script.done();
}

const std::vector<SessionKind>& session_kinds() {
  static const std::vector<SessionKind> kinds{{"modbus_rtu", modbus_rtu_session},
                                              {"modbus_tcp", modbus_tcp_session},
                                              {"nmea", nmea_session},
                                              {"ubx", ubx_session},
                                              {"scip", scip_session},
                                              {"mavlink1", mavlink1_session},
                                              {"mavlink2", mavlink2_session},
                                              {"gdb", gdb_session}};
  return kinds;
}

}  // namespace porttape::test
