#include "libport/port/forwarding_port.hpp"

#include <utility>

namespace porttape {

ForwardingPort::ForwardingPort(std::unique_ptr<Port> inner) : inner_(std::move(inner)) {
  inner_->listen(*this);
}

Result<void> ForwardingPort::prepare() { return inner_->prepare(); }
void ForwardingPort::open() { inner_->open(); }
void ForwardingPort::close() { inner_->close(); }
void ForwardingPort::write(ByteView data) { inner_->write(data); }
bool ForwardingPort::congested() const { return inner_->congested(); }
bool ForwardingPort::end_writing() { return inner_->end_writing(); }
std::optional<std::size_t> ForwardingPort::unread_by_peer() const { return inner_->unread_by_peer(); }
std::optional<LineSettings> ForwardingPort::settings() const { return inner_->settings(); }
Result<void> ForwardingPort::apply(const LineSettings& settings) { return inner_->apply(settings); }
void ForwardingPort::tell(const LineEvent& event) { inner_->tell(event); }
void ForwardingPort::set_reading(bool on) { inner_->set_reading(on); }
void ForwardingPort::hang_up(bool after_reading) { inner_->hang_up(after_reading); }
void ForwardingPort::read_pending() { inner_->read_pending(); }
bool ForwardingPort::left_bytes() const { return inner_->left_bytes(); }
void ForwardingPort::finish() { inner_->finish(); }
PortFacets ForwardingPort::facets() {
  PortFacets facets = inner_->facets();
  if (facets.waiting != nullptr) facets.waiting = this;
  facets.connections = nullptr;
  return facets;
}
PortTraits ForwardingPort::traits() const { return inner_->traits(); }
std::string ForwardingPort::name() const { return inner_->name(); }
PortPlace ForwardingPort::place() const { return inner_->place(); }
std::optional<PortIdentity> ForwardingPort::identity() const { return inner_->identity(); }

void ForwardingPort::on_up() { listener().on_up(); }
void ForwardingPort::on_data(ByteView data) { listener().on_data(data); }
void ForwardingPort::on_arrivals(ByteView data, std::span<const std::size_t> ends) {
  listener().on_arrivals(data, ends);
}
void ForwardingPort::on_drained() { listener().on_drained(); }
void ForwardingPort::on_down(const LineDown& down) { listener().on_down(down); }
void ForwardingPort::on_finished(int exit_status) { listener().on_finished(exit_status); }
void ForwardingPort::on_complete(int exit_status) { listener().on_complete(exit_status); }
PortListener::Answers ForwardingPort::on_ended() { return listener().on_ended(); }
bool ForwardingPort::half_closes() const { return listener().half_closes(); }
std::optional<std::size_t> ForwardingPort::unread() const { return listener().unread(); }
bool ForwardingPort::wants_rest() { return listener().wants_rest(); }
void ForwardingPort::on_interrupted(const LineDown& down) { listener().on_interrupted(down); }
void ForwardingPort::on_resumed() { listener().on_resumed(); }
void ForwardingPort::told(const LineEvent& event) { listener().told(event); }

std::size_t ForwardingPort::write_some(ByteView data) {
  if (WaitingCalls* const calls = inner_->waiting()) return calls->write_some(data);
  inner_->write(data);
  return data.size();
}
std::size_t ForwardingPort::unsent() {
  WaitingCalls* const calls = inner_->waiting();
  return calls != nullptr ? calls->unsent() : 0;
}
bool ForwardingPort::discard() {
  WaitingCalls* const calls = inner_->waiting();
  return calls == nullptr || calls->discard();
}
std::string ForwardingPort::awaits() {
  WaitingCalls* const calls = inner_->waiting();
  return calls != nullptr ? calls->awaits() : std::string();
}
std::optional<Instant> ForwardingPort::next_due() {
  WaitingCalls* const calls = inner_->waiting();
  return calls != nullptr ? calls->next_due() : std::nullopt;
}

}  // namespace porttape
