#include "tests/flexiport/mirror.hpp"

#include <sstream>

namespace mirror {

std::string drive(void* object) {
  Port* const port = static_cast<Port*>(object);
  std::ostringstream out;
  char buffer[32] = {};
  std::string text;
  out << port->type << ' ' << port->debug << ' ' << port->wait.sec << ' ' << port->may_read << port->may_write
      << port->always_open << '\n';
  port->open();
  out << "open " << port->is_open() << '\n';
  out << "read " << port->read(buffer, 2) << ' ' << std::string(buffer, 2) << '\n';
  out << "read_full " << port->read_full(buffer, 3) << ' ' << std::string(buffer, 3) << '\n';
  out << "read_until " << port->read_until(buffer, 9, ';') << '\n';
  out << "read_string_until " << port->read_string_until(text, ';') << ' ' << text << '\n';
  out << "read_line_into " << port->read_line_into(buffer, 9) << ' ' << buffer;
  out << "read_line " << port->read_line(text) << ' ' << text;
  out << "skip " << port->skip(2) << '\n';
  out << "skip_until " << port->skip_until('x', 2) << '\n';
  out << "bytes_available " << port->bytes_available() << '\n';
  out << "bytes_available_wait " << port->bytes_available_wait() << '\n';
  out << "read_string " << port->read_string(text) << ' ' << text << '\n';
  out << "write " << port->write("a", 1) << port->write_full("bc", 2) << port->write_text("def")
      << port->write_string("ghij") << '\n';
  port->flush();
  port->drain();
  out << "status " << (port->status().find("logreader") != std::string::npos) << '\n';
  port->set_timeout(Timeout(0, 0));
  out << "timeout " << port->timeout().sec << ' ' << port->timeout().usec << ' ' << port->is_blocking()
      << '\n';
  port->set_can_read(false);
  out << "can_read " << port->can_read() << port->may_read << '\n';
  port->set_can_write(false);
  out << "can_write " << port->can_write() << port->may_write << '\n';
  port->close();
  out << "open " << port->is_open() << '\n';
  delete port;
  return out.str();
}

Layout layout() {
  // Offsets in an object of the mirror's, without making one: the class is abstract and has a vptr.
  alignas(std::max_align_t) static char room[sizeof(Port)];
  const Port* const port = reinterpret_cast<const Port*>(room);
  const auto at = [&](const void* member) {
    return static_cast<std::size_t>(static_cast<const char*>(member) - room);
  };
  return {sizeof(Port),        at(&port->type),      at(&port->debug),      at(&port->wait),
          at(&port->may_read), at(&port->may_write), at(&port->always_open)};
}

}  // namespace mirror
