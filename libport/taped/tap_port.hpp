#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "libport/loop/timer.hpp"
#include "libport/port/context.hpp"
#include "libport/port/forwarding_port.hpp"
#include "libport/taped/line_observer.hpp"
#include "libport/taped/repeat_filter.hpp"

namespace porttape {

// A port around another that tells observers what passes: stamps bytes and events, and passes them on first.
// What is told while a block is being passed on (a listener that answers or closes from on_data, a port that
// answers within write) comes behind that block. Of settings they are told what is new, and of flushes those
// that may drop something (RepeatFilter). Owns the observers. With a TapeKeeper among them it records.
// Bytes that come once they finish are told in the log alone.
class TapPort final : public ForwardingPort, private Recorder {
 public:
  // How long finish() waits for the observers.
  static constexpr std::chrono::seconds kEndLimit{10};

  TapPort(const PortContext& context, std::unique_ptr<Port> inner, Nanos end_limit = kEndLimit);
  ~TapPort() override;  // gives up the observers that have not finished

  // Before anything else is called.
  void add(std::unique_ptr<LineObserver> observer);
  // For an observer that cannot do its work any more: the session ends with exit_status::kRuntime.
  void must_end();

  Result<void> prepare() override;
  void open() override;
  void close() override;
  void write(ByteView data) override;
  bool end_writing() override;
  void set_reading(bool on) override;
  void hang_up(bool after_reading) override;
  void read_pending() override;
  Result<void> apply(const LineSettings& settings) override;
  void tell(const LineEvent& event) override;
  void finish() override;
  [[nodiscard]] PortFacets facets() override {
    PortFacets facets = ForwardingPort::facets();
    facets.recorder = this;
    return facets;
  }

 private:
  std::size_t write_some(ByteView data) override;
  bool discard() override;
  Result<void> request(const RecorderRequest& what) override;
  [[nodiscard]] std::optional<RecordingStatus> recording() const override;
  void note_gap(std::uint64_t bytes, std::string_view why) override;

  void on_up() override;
  void on_data(ByteView data) override;
  void on_arrivals(ByteView data, std::span<const std::size_t> ends) override;
  void on_down(const LineDown& down) override;
  void on_complete(int exit_status) override;
  Answers on_ended() override;
  void on_interrupted(const LineDown& down) override;
  void on_resumed() override;
  void told(const LineEvent& event) override;

  struct Blocks;
  struct Observer {
    std::unique_ptr<LineObserver> observer;
    bool finished = false;
    LineObserver* operator->() const { return observer.get(); }
  };

  void observer_finished(Observer& observer, bool complete);
  void give_up_observers();
  void complete_if_over();
  bool tell_late();
  template <class PassOn>
  void pass(const Blocks& blocks, const PassOn& pass_on);
  void tell_passed();
  template <class Tell>
  void tell_observers(const Tell& what);
  void tell_blocks(const Blocks& blocks);
  void note(const Event& event);
  void note_line(const TapedLineEvent& event);
  void note_device_settings();
  void note_lost(const LineDown& down, bool hung_up);

  std::shared_ptr<spdlog::logger> log_;
  Loop* loop_;
  std::vector<Observer> observers_;
  const Blocks* passing_ = nullptr;  // are passed on just now, and not told yet
  Timer end_timer_;
  Nanos end_limit_;
  bool over_ = false;       // nobody is told any more
  bool finishing_ = false;  // finish() of each was called
  std::uint64_t late_bytes_ = 0;
  int exit_status_ = 0;
  bool open_ = false;
  bool writing_ended_ = false;  // in this session
  RepeatFilter repeats_;
  std::map<RequestNumber, Instant> drains_;  // of this session, that have begun
};

}  // namespace porttape
