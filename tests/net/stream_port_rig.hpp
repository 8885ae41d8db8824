#pragma once

#include <chrono>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "libport/catalog/port_types.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/sockets.hpp"

namespace porttape {

// What both kinds of stream sockets do; shown with TCP on the loopback interface.
class StreamPortRig : public testing::Test {
 protected:
  using Socket = test::Socket;

  void make(const std::string& spec) {
    const Result<PortSpec> options = parse_port(spec);
    ASSERT_TRUE(options.has_value()) << options.error().message;
    Result<std::unique_ptr<Port>> made = make_port({&loop, book.log()}, *options, "test");
    ASSERT_TRUE(made.has_value());
    port = std::move(*made);
    port->listen(log);
  }
  void make_listening(const std::string& more = {}) {
    make("tcp-listen:0" + more);
    number = test::prepare_any(*port);
    port->open();
  }
  void make_connecting(const std::string& more = {}) {
    make("tcp:127.0.0.1:" + std::to_string(server.port()) + more);
    ASSERT_TRUE(port->prepare().has_value());
  }
  void until(const std::string& events) {
    run_until(loop, [&] { return log.events == events || log.events.size() > events.size() + 40; });
    EXPECT_EQ(log.events, events);
  }
  void until_data(const std::string& data) {
    run_until(loop, [&] { return log.data == data; });
  }
  // Turns the loop until the peer has seen that.
  void until_got(Socket& peer, const std::string& text, const std::string& ended = {}) {
    Timer tick(loop, [] {});
    run_until(loop, [&] {
      tick.set_after(std::chrono::milliseconds(1));
      peer.receive();
      return peer.got == text && peer.ended == ended;
    });
  }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }
  Socket up() {  // a client of the listening port
    Socket peer = Socket::connect_to(number);
    run_until(loop, [&] { return log.events.ends_with("up "); });
    return peer;
  }
  Socket accepted() {  // the server's end of the connecting port's connection
    run_until(loop, [&] { return log.events.ends_with("up ") && server.readable(); });
    return server.accept();
  }

  Loop loop;
  LogBook book;
  PortLog log;
  Socket server = Socket::listening();
  std::uint16_t number = 0;
  std::unique_ptr<Port> port;
};

}  // namespace porttape
