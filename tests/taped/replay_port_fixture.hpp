#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include <gtest/gtest.h>

#include "libport/taped/replay_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {

// A port that plays the tape t.log of a folder of its own, as a session drives it.
class ReplayPortTest : public testing::Test {
 protected:
  void start(const std::string& report = {}, OnMismatch on_mismatch = OnMismatch::fail, bool open = true) {
    ReplayPort::Options options;
    options.tape = literal_tape(dir / "t.log");
    options.config.on_mismatch = on_mismatch;
    options.config.match = match;
    options.config.chunks = chunks;
    options.report_file = report;
    options.once = once;
    options.ends_with_run = ends_with_run;
    options.looks_on = looks_on;
    options.session = session;
    port = std::make_unique<ReplayPort>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
    if (open) port->open();
  }
  void write(std::string_view text) { port->write(as_bytes(text)); }
  // How long it took until finish() was done.
  Nanos finish() {
    const Instant begin = loop.now();
    port->finish();
    run_until(loop, [this] { return log.status.has_value(); });
    return loop.now() - begin;
  }

  test::TempDir dir;
  Loop loop;
  LogBook book;
  PortLog log;
  bool once = false;
  bool ends_with_run = false;
  bool looks_on = false;
  std::uint64_t session = 0;
  Match match = Match::sequence;
  Chunks chunks = Chunks::automatic;
  std::unique_ptr<ReplayPort> port;
};

}  // namespace porttape
