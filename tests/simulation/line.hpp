#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/port/port.hpp"
#include "tests/simulation/line_queue.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

class LinePort;

std::string_view name_of(FlushQueue queue);

// A line with a program or a device at its far end, and what passed on it. The near end is a LinePort; while
// there is none (between two sessions) the far end waits.
class Line {
 public:
  struct Kind {
    bool passive = false;  // it is a driver's line, or a device that connects
    bool is_device = false;
    bool half_closes = false;   // as sockets do
    bool knows_unread = false;  // unread_by_peer() tells
    bool always_open = false;   // an interruption is mended by the port
    // A driver's: its calls are seen one by one (SupervisedLine), so that its acts have their exact place and
    // it has signals, drains and questions.
    bool supervised = false;
    // A device's: it is a serial line, with settings, signals and answers.
    bool serial = false;
    bool datagrams = false;       // each write is one; such a line has no acts
    std::size_t capacity = 4096;  // bytes that the system takes on the way to the far end, and from it

    // As chance wants them. Neither is supervised or serial.
    static Kind of_driver(World& world);
    static Kind of_device(World& world);
  };

  Line(World& world, std::string name, Kind kind)
      : world_(&world),
        name_(std::move(name)),
        kind_(kind),
        to_near_(kind.datagrams),
        to_far_(kind.datagrams) {}
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  // The far end. A driver opens and closes; a device is there or is not.
  void open();
  void close();
  // Takes what fits; how much that was.
  std::size_t send(ByteView data);
  // Reads up to `most` bytes and passes them to on_read. Signals and settings of the near end are passed to
  // on_signal and on_settings in their place among the bytes.
  void read(std::size_t most);
  void half_close();
  void unplug();  // a device
  // A device that breaks the line in a way which lets the other side read what it had sent (or not).
  void lose(bool after_reading);
  void plug_in();

  // Acts of a driver. On a supervised line the near end learns of each act after the bytes that were sent
  // before it. If those bytes are not read for five seconds, the act overtakes them
  // (TtyCalls::kCatchUpLimit). On any other line the near end learns of settings by looking: it gets the last
  // ones, before bytes that wait. Such a line has no signals, and answers a drain or a question at once.
  //
  // A device has signals only: those that it drives.
  void signal(const LineSignal& signal);
  void set(const SeenSettings& settings);
  // `in` drops the bytes that the driver has not read, `out` the bytes that the near end has not taken.
  void flush(FlushQueue queue);
  // `done` is called once: when the near end says so, or the line is over.
  void drain(std::function<void()> done);
  void ask(const LineRequest& request, TakeAnswer done);

  [[nodiscard]] bool is_open() const { return open_; }
  [[nodiscard]] std::size_t unread() const { return to_far_.bytes(); }
  [[nodiscard]] std::size_t unsent() const { return to_near_.bytes(); }
  [[nodiscard]] bool near_ended() const { return near_ended_; }
  // Whether the near end knows that the far end is there.
  [[nodiscard]] bool is_up() const;
  // Whether the near end hung up before it had seen settings that the far end had made.
  [[nodiscard]] bool ended_before_settings() const { return ended_before_settings_; }
  // The settings that a driver finds, or that a device has taken.
  [[nodiscard]] const LineSettings& settings() const { return settings_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] const Kind& kind() const { return kind_; }
  // Drains and questions of the far end that the listener of the port has been told of and has not answered.
  [[nodiscard]] std::size_t unanswered() const { return told_.size(); }

  std::function<void(ByteView)> on_read = [](ByteView) {};
  std::function<void()> on_readable = [] {};  // something came for the far end
  // The near end gave up bytes for a far end that is there.
  std::function<void(std::size_t)> on_cut = [](std::size_t) {};
  std::function<void()> on_broken = [] {};  // the near end closed it or hung up
  // The near end called signal() or apply(). A device learns of the call after it has read the bytes that
  // were written before; a driver learns of it at once.
  std::function<void(const LineSignal&)> on_signal = [](const LineSignal&) {};
  std::function<void(const LineSettings&)> on_settings = [](const LineSettings&) {};
  std::function<void()> on_prepare = [] {};  // the near end's port was called by prepare()
  std::function<void()> on_open = [] {};     // and by open()
  // The near end's port was told of a flush or of settings.
  std::function<void(FlushQueue)> on_peer_flushed = [](FlushQueue) {};
  std::function<void(const SeenSettings&, SettingsOrder)> on_peer_set = [](const SeenSettings&,
                                                                           SettingsOrder) {};
  // The device's answer. The near end gets it after up to two seconds.
  std::function<LineAnswer(const LineRequest&)> on_ask = [](const LineRequest&) { return LineAnswer{}; };

  // In order, what the port and its listener gave each other.
  std::vector<Passed> passed;
  std::uint64_t bytes_in = 0;       // to the listener
  std::uint64_t bytes_out = 0;      // from it
  std::uint64_t bytes_dropped = 0;  // told by on_dropped
  std::uint64_t bytes_unread = 0;   // at the end, as unread_by_peer() told
  Instant last_read{};              // by the far end
  std::size_t most_kept = 0;        // bytes for the far end beyond the capacity, at most

 private:
  friend class LinePort;

  void broken();
  void drained(std::uint64_t number);
  void answered(std::uint64_t number, const std::optional<LineAnswer>& answer);
  void put_act(Passed act);
  void reach_acts();
  void forget_acts();

  World* world_;
  std::string name_;
  Kind kind_;
  LinePort* port_ = nullptr;
  bool open_ = false;
  bool ended_ = false;       // the far end sends no more
  bool near_ended_ = false;  // the near end sends no more
  bool closing_ = false;     // the far end has closed; the near end has not seen it yet
  LineQueue to_near_;
  LineQueue to_far_;
  std::optional<SeenSettings> set_;  // by the far end, and not seen by the near end yet
  bool unseen_settings_ = false;     // of the far end, sampled or in their place
  bool ended_before_settings_ = false;
  LineSettings settings_;
  std::map<LineSignal::Name, bool> signals_;  // of a device, as they stand
  std::map<std::uint64_t, std::function<void()>> drains_;
  std::map<std::uint64_t, TakeAnswer> questions_;
  std::set<std::uint64_t> told_;  // of both, to the listener
};

}  // namespace porttape::simulation
