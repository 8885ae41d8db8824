#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
#include "libport/taped/replayed_device.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {

// A port that plays the tape t.log of a folder of its own, as a session drives it.
class ReplayPortTest : public testing::Test {
 protected:
  void start(const std::string& report = {}, OnMismatch on_mismatch = OnMismatch::fail, bool open = true) {
    ReplayOptions options;
    options.tape = literal_tape(dir / "t.log");
    options.config.on_mismatch = on_mismatch;
    options.config.match = match;
    options.config.chunks = chunks;
    options.config.timing = timing;
    options.config.strictness = strictness;
    options.config.at_end = at_end;
    options.report_file = report;
    options.once = once;
    options.ends_with_run = ends_with_run;
    options.looks_on = looks_on;
    options.session = session;
    port = std::make_unique<ReplayedDevice>(PortContext{&loop, book.log()}, std::move(options));
    port->listen(log);
    ASSERT_TRUE(port->prepare().has_value());
    if (open) port->open();
  }
  void write(std::string_view text) { port->write(as_bytes(text)); }
  // A driver that asks, flushes the answer that is due before it reads it, asks again, reads and closes. The
  // tape has "old" and "new" as the answers.
  void flush_unread(FlushQueue queue) {
    test::write_file(dir / "t.logw", test::block_bytes({{0, "ask"}, {5'000, "more"}}));
    test::write_file(dir / "t.logr", test::block_bytes({{1, "old"}, {5'001, "new"}}));
    test::write_file(dir / "t.loge", as_bytes(encode(TapeHeader{})));
    start();
    port->set_reading(false);
    write("ask");
    run_until(loop, [begin = loop.now(), this] {
      loop.post([] {});
      return loop.now() - begin > std::chrono::milliseconds(5);
    });
    port->tell(line::Flush{queue});
    port->set_reading(true);
    write("more");
    run_until(loop, [this] { return log.data.ends_with("new"); });
    port->close();
  }
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
  Timing timing = ReplayConfig{}.timing;
  int strictness = ReplayConfig{}.strictness;
  AtEnd at_end = ReplayConfig{}.at_end;
  std::unique_ptr<ReplayPort> port;
};

}  // namespace porttape
