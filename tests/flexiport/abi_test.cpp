// The binary interface (order of virtual functions, place of data members), and classes derived from the
// ports.

#include <flexiport/flexiport.h>
#include <flexiport/logreaderport.h>
#include <flexiport/port.h>
#include <fstream>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "tests/flexiport/mirror.hpp"
#include "tests/support/temp_dir.hpp"

namespace {

// A tape of one block that is due at once.
void make_tape(const std::string& file, const std::string& sent) {
  std::ofstream(file + "r", std::ios::binary)
      << std::string("\0\0\0\0\0\0\0\0\0\0\0", 11) << static_cast<char>(sent.size()) << sent;
  std::ofstream(file + "w").close();
}

// Makes Port's members visible, without changing where they are.
class Opened : public flexiport::Port {
 public:
  static mirror::Layout layout() {
    alignas(16) static char room[sizeof(flexiport::Port)];
    const Opened* const port = reinterpret_cast<const Opened*>(room);
    const auto at = [&](const void* member) {
      return static_cast<std::size_t>(static_cast<const char*>(member) - room);
    };
    return {sizeof(flexiport::Port), at(&port->_type),     at(&port->_debug),     at(&port->_timeout),
            at(&port->_canRead),     at(&port->_canWrite), at(&port->_alwaysOpen)};
  }
};

TEST(FlexiportAbi, MembersAreWhereOldProgramsLookForThem) {
  const mirror::Layout ours = Opened::layout();
  const mirror::Layout theirs = mirror::layout();
  EXPECT_EQ(ours.size, theirs.size);
  EXPECT_EQ(ours.type, theirs.type);
  EXPECT_EQ(ours.debug, theirs.debug);
  EXPECT_EQ(ours.timeout, theirs.timeout);
  EXPECT_EQ(ours.can_read, theirs.can_read);
  EXPECT_EQ(ours.can_write, theirs.can_write);
  EXPECT_EQ(ours.always_open, theirs.always_open);
  EXPECT_EQ(ours.type, sizeof(void*));
}

TEST(FlexiportAbi, VirtualFunctionsAreCalledThroughTheOldOrder) {
  const porttape::test::TempDir dir;
  const std::string file = dir / "t.log";
  const std::string sent = "12345ab;cd;line\nnext\n--.x.xrest";
  make_tape(file, sent);
  flexiport::Port* const port = flexiport::CreatePort("type=logreader,debug=0,timeout=5,file=" + file);
  EXPECT_EQ(mirror::drive(port),
            "logreader 0 5 110\n"
            "open 1\n"
            "read 2 12\n"
            "read_full 3 345\n"
            "read_until 3\n"
            "read_string_until 3 cd;\n"
            "read_line_into 5 line\n"
            "read_line 5 next\n"
            "skip 2\n"
            "skip_until 4\n"
            "bytes_available 4\n"
            "bytes_available_wait 4\n"
            "read_string 4 rest\n"
            "write 1234\n"
            "status 1\n"
            "timeout 0 0 0\n"
            "can_read 00\n"
            "can_write 00\n"
            "open 0\n");
}

// Reads what the device sent with every letter moved on by one.
class Shifted : public flexiport::LogReaderPort {
 public:
  using LogReaderPort::LogReaderPort;
  ssize_t Read(void* const buffer, size_t count) override {
    const ssize_t size = LogReaderPort::Read(buffer, count);
    for (ssize_t i = 0; i < size; ++i) ++static_cast<char*>(buffer)[i];
    return size;
  }
};

TEST(Flexiport, AnOverriddenReadIsWhatTheOthersCall) {
  const porttape::test::TempDir dir;
  const std::string file = dir / "t.log";
  const std::string sent = "abc;rest";
  make_tape(file, sent);
  Shifted port({{"type", "logreader"}, {"file", file}, {"timeout", "5"}});
  port.Open();
  std::string text;
  EXPECT_EQ(port.ReadStringUntil(text, ';' + 1), 4);
  EXPECT_EQ(text, "bcd<");
  EXPECT_EQ(port.ReadString(text), 4);
  EXPECT_EQ(text, "sftu");
}

TEST(Flexiport, TypesThatItHasNoClassForAreThere) {
  const std::unique_ptr<flexiport::Port> pty(flexiport::CreatePort("type=pty,timeout=0"));
  EXPECT_EQ(pty->GetPortType(), "pty");
  const std::unique_ptr<flexiport::Port> unix_socket(flexiport::CreatePort("type=unix,path=/nowhere/x"));
  EXPECT_THROW(unix_socket->Open(), flexiport::PortException);
  try {
    delete flexiport::CreatePort("type=modem");
    FAIL() << "a type that is not there";
  } catch (const flexiport::PortException& error) {
    EXPECT_NE(std::string(error.what()).find("serial"), std::string::npos) << error.what();
  }
}

}  // namespace
