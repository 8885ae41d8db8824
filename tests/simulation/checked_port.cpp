#include "tests/simulation/checked_port.hpp"

#include <utility>

namespace porttape::simulation {

CheckedPort::CheckedPort(World& world, std::unique_ptr<Port> inner, bool lenient)
    : ForwardingPort(std::move(inner)), world_(&world), lenient_(lenient) {}

void CheckedPort::expect(bool allowed, const char* what) {
  if (!allowed) world_->wrong("{}: port.hpp does not allow {}", inner().name(), what);
}

void CheckedPort::expect_up(const char* what) {
  if (!up_ && !lenient_)
    world_->wrong("{}: port.hpp does not allow {} while the line is not up", inner().name(), what);
}

Result<void> CheckedPort::prepare() {
  expect(!std::exchange(prepared_, true), "a second prepare()");
  return ForwardingPort::prepare();
}

void CheckedPort::open() {
  expect(prepared_, "open() before prepare()");
  expect(!finished_, "open() after finish()");
  expect(!std::exchange(opened_, true), "a second open() without close()");
  was_congested_ = writing_ended_ = ended_ = false;
  ForwardingPort::open();
}

void CheckedPort::close() {
  opened_ = up_ = false;
  ForwardingPort::close();
}

void CheckedPort::write(ByteView data) {
  expect(!writing_ended_, "write() after end_writing()");
  const bool may_be_of_arrivals = ForwardingPort::keeps_datagrams();
  expect(!up_ || !ForwardingPort::congested() || may_be_of_arrivals, "write() while congested()");
  ForwardingPort::write(data);
  was_congested_ = was_congested_ || ForwardingPort::congested();
}

bool CheckedPort::end_writing() {
  const bool ends = ForwardingPort::end_writing();
  writing_ended_ = true;
  return ends;
}

void CheckedPort::set_reading(bool on) {
  reading_ = on;
  ForwardingPort::set_reading(on);
}

void CheckedPort::finish() {
  expect(!std::exchange(finished_, true), "a second finish()");
  opened_ = up_ = false;
  ForwardingPort::finish();
}

void CheckedPort::on_up() {
  expect(opened_, "on_up() without open()");
  expect(!std::exchange(up_, true), "on_up() of a line that is up");
  was_congested_ = writing_ended_ = ended_ = false;
  ForwardingPort::on_up();
}

// A port that is passive or always open passes data on between close() and open(), too.
void CheckedPort::expect_data() {
  expect(up_ || !opened_ || lenient_, "on_data() before on_up()");
  expect(reading_, "on_data() after set_reading(false)");
}

void CheckedPort::on_data(ByteView data) {
  expect_data();
  ForwardingPort::on_data(data);
}

void CheckedPort::on_arrivals(ByteView data, std::span<const std::size_t> ends) {
  expect_data();
  ForwardingPort::on_arrivals(data, ends);
}

void CheckedPort::on_drained() {
  expect_up("on_drained()");
  expect(std::exchange(was_congested_, false) || lenient_, "on_drained() without congestion");
  expect(!ForwardingPort::congested(), "on_drained() while congested()");
  ForwardingPort::on_drained();
}

void CheckedPort::on_down(const LineDown& down) {
  expect(opened_, "on_down() after close()");
  up_ = false;
  ForwardingPort::on_down(down);
}

void CheckedPort::on_complete(int exit_status) {
  expect(finished_, "on_complete() before finish()");
  expect(!std::exchange(completed_, true), "a second on_complete()");
  ForwardingPort::on_complete(exit_status);
}

PortListener::Answers CheckedPort::on_ended() {
  expect_up("on_ended()");
  expect(!std::exchange(ended_, true), "a second on_ended()");
  return ForwardingPort::on_ended();
}

void CheckedPort::on_interrupted(const LineDown& down) {
  expect(!std::exchange(interrupted_, true) || lenient_, "on_interrupted() of a line that is interrupted");
  ForwardingPort::on_interrupted(down);
}

void CheckedPort::on_resumed() {
  expect(std::exchange(interrupted_, false) || lenient_, "on_resumed() of a line that is not interrupted");
  ForwardingPort::on_resumed();
}

void CheckedPort::told(const LineEvent& event) {
  if (keeps_place(event)) expect_up("told() of what has its place among the bytes");
  ForwardingPort::told(event);
}

}  // namespace porttape::simulation
