#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "libport/base/bytes.hpp"
#include "libport/base/port_identity.hpp"
#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_event.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/port/port_place.hpp"
#include "libport/port/supervised_line.hpp"

namespace porttape {

// Why a line is no longer up.
struct LineDown {
  enum class Reason {
    closed,  // the peer closed it, as peers do
    failed,  // open() could not bring it up
    lost,    // the device went away while open
    hung_up  // hang_up() was called, or the device of a tape broke the line
  };
  Reason reason = Reason::closed;
  Error error;                 // what, where and what to do, for failed and lost
  bool after_reading = false;  // to be given to hang_up() of the session's other port
};

// Calls `take` with each arrival, see PortListener::on_arrivals().
template <class Take>
void for_each_arrival(ByteView data, std::span<const std::size_t> ends, const Take& take) {
  std::size_t begin = 0;
  for (const std::size_t end : ends) {
    take(data.subspan(begin, end - begin));
    begin = end;
  }
}

// What a port tells the one who drives it. All calls come on the loop's thread.
class PortListener {
 public:
  // The line to the peer is up. Follows open(), possibly from within it; on passive ports again and again.
  virtual void on_up() = 0;
  // Bytes from the peer, as they came; valid during the call. A passive or always-open port passes them on
  // between close() and open() too, since the device sends whether anybody listens or not.
  virtual void on_data(ByteView data) = 0;
  // All that write() took has been passed on: congested() is false again. Only after congestion.
  virtual void on_drained() = 0;
  // The line is down. A passive port waits for the next peer by itself.
  virtual void on_down(const LineDown& down) = 0;
  // The port asks for the end of the session with this exit status: a replay that is to run once, or, with
  // exit_status::kRuntime, a tape that must not fail (the session then ends within 2 s).
  virtual void on_finished(int exit_status) = 0;
  // What finish() asked for is done: tape and report are complete, or given up and told. The exit status, 0
  // when the port has no opinion.
  virtual void on_complete(int exit_status) = 0;

  // As on_data; `ends` says where each arrival ends in `data` (the last is its size), for lines that keep
  // datagrams.
  virtual void on_arrivals(ByteView data, std::span<const std::size_t> ends) {
    (void)ends;
    on_data(data);
  }
  // The peer sends no more but still reads (half-close). What of its answers?
  enum class Answers {
    none,              // the line goes down at once
    until_hang_up,     // hang_up() will follow the last one
    until_it_is_quiet  // nobody will say which is the last: the port decides
  };
  virtual Answers on_ended() { return Answers::none; }
  // Whether the session's other line has a half-close (has_half_close() of its port).
  [[nodiscard]] virtual bool half_closes() const { return false; }
  // Bytes passed on that the peer at the session's other line has not taken yet; nothing where that is not
  // known (unread_by_peer() of its port).
  [[nodiscard]] virtual std::optional<std::size_t> unread() const { return std::nullopt; }
  // The peer is gone while it is not being read. True: what it has left will be read, when the other line has
  // taken what it was given (unread()).
  virtual bool wants_rest() { return false; }
  // The line is interrupted, and the port brings it up again by itself (`alwaysopen`): the session goes on,
  // nothing should be written until on_resumed(). Also between close() and open().
  virtual void on_interrupted(const LineDown&) {}
  virtual void on_resumed() {}
  // Something else has happened on the line, where the peer is: see LineEvent. Events come in their order
  // among the bytes. A line::Drain and a line::Ask are to be answered, by tell() of the port that told of
  // them.
  virtual void told(const LineEvent& event) { (void)event; }

 protected:
  ~PortListener() = default;
};

// What a program that waits in its calls asks of a port besides (BlockingPort, `porttape test`). A port
// without it takes all that is written and keeps nothing that could be dropped.
class WaitingCalls {
 public:
  // Takes only what can be sent at once and gives how much that was. After less than all, on_drained() comes
  // when more can go.
  virtual std::size_t write_some(ByteView data) = 0;
  // Bytes that were taken but have not left this machine.
  [[nodiscard]] virtual std::size_t unsent() = 0;
  // Drops what came in and was not read, and what was taken and is not sent. False: the bytes that were
  // passed on already are not to be dropped either.
  virtual bool discard() = 0;
  // What is to happen first, where nothing can come until the caller does something; for one who would wait
  // for ever. Empty: nothing.
  [[nodiscard]] virtual std::string awaits() { return {}; }
  // When it will do something by itself; none while only the caller can move things on.
  [[nodiscard]] virtual std::optional<Instant> next_due() { return std::nullopt; }

 protected:
  ~WaitingCalls() = default;
};

// What a user asks of those who record, while they do.
struct RecorderRequest {
  // Notes this on the tape, in its place among the bytes; nothing: ends the tape and begins another.
  std::optional<LineEvent> note;

  static RecorderRequest next_tape() { return {}; }
  static RecorderRequest mark(std::string text) { return {line::Mark{std::move(text)}}; }
};

// How a recording stands, for one who asks.
struct RecordingStatus {
  enum class State : std::uint8_t {
    waiting,    // for the first driver: there is no tape yet
    recording,  // also between two drivers
    failing,    // the disk does not take the last bytes
    not_made    // the tape cannot be made; tried again
  };
  State state = State::waiting;
  std::string tape;                // its name
  std::uint64_t bytes = 0;         // of both directions, on the tape
  std::uint64_t lost_bytes = 0;    // that passed and are not on it
  std::uint64_t queued_bytes = 0;  // wait for a slow disk
  std::string why = {};            // of failing and not_made
};

// What records a line.
class Recorder {
 public:
  // Errc::usage: it cannot be done now, with the reason.
  virtual Result<void> request(const RecorderRequest& what) = 0;
  // None: it keeps no tape.
  [[nodiscard]] virtual std::optional<RecordingStatus> recording() const { return std::nullopt; }
  // So many bytes of the session reached nobody at the line's other end.
  virtual void note_gap(std::uint64_t bytes, std::string_view why) = 0;

 protected:
  ~Recorder() = default;
};

// What a user asks of a tape that plays, while it does.
struct PlaybackRequest {
  enum class Kind : std::uint8_t {
    pause,   // the clock stands: nothing is delivered, nothing is late
    resume,  // and goes on
    step,    // while it stands: `exchanges` come at once
    seek,    // the session goes on at `to` of the tape
    rate     // from now on time runs `rate` times as fast
  };
  Kind kind = Kind::pause;
  std::uint64_t exchanges = 1;
  Micros to{};
  double rate = 1;
};

// How a replay stands, for one who asks.
struct PlaybackStatus {
  bool paused = false;
  double rate = 1;
  // While a driver is there; times are the tape's.
  std::optional<Micros> position = {};
  std::uint64_t loop = 0;                  // 1-based
  std::optional<std::uint64_t> loops = 1;  // nothing: for ever
  std::optional<Micros> length = {};       // if it is known
};

// What plays a tape.
class Playback {
 public:
  // Errc::usage: it cannot be done, or not now, with the reason.
  virtual Result<void> request(const PlaybackRequest& what) = 0;
  [[nodiscard]] virtual PlaybackStatus playback() = 0;

 protected:
  ~Playback() = default;
};

class Port;

// A passive port that peers connect to, and that can give each connection away.
class ConnectionSource {
 public:
  // A port of the connection alone, not passive, to be opened once; destroyed before, its peer sees a reset.
  // `who`, for messages, is at the other end.
  using TakeConnection = std::function<void(std::unique_ptr<Port> connection, const std::string& who)>;
  // From open() to close() it gives every connection to `take` and never comes up itself. Before prepare().
  virtual void give_each(TakeConnection take) = 0;
  // How many the user wants to have at once; whoever takes them refuses more, by destroying them.
  [[nodiscard]] virtual std::size_t most_connections() const = 0;

 protected:
  ~ConnectionSource() = default;
};

// What kind of line a port has.
struct PortTraits {
  bool passive = false;          // waits for the next peer by itself when one has closed
  bool keeps_datagrams = false;  // each write() reaches the peer as one datagram, and each on_data() is one
  bool has_half_close = false;  // can end in one direction: end_writing() gives true, and on_ended() may come
  // The peer's signals are told, and it is shown those of the other end. Of a pty since it is supervised.
  bool shows_signals = false;
};

// The further interfaces of a port; null where it has nothing to do there.
struct PortFacets {
  WaitingCalls* waiting = nullptr;
  Recorder* recorder = nullptr;
  Playback* playback = nullptr;
  ConnectionSource* connections = nullptr;
  SupervisedLine* supervised = nullptr;
};

// One end of a line: a pty, a serial device, a socket, a tape, or a port that records another.
//
// Drive it: listen(), prepare() once, then open() and close() in turn; finish() before the end. A *passive*
// port (a pty, a listening socket) exists from prepare() on and comes up when a peer arrives while it is
// open(); the others come up by open() alone. Never blocks. Lives on one Loop; loop thread only.
class Port {
 public:
  Port() = default;
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;
  virtual ~Port() = default;

  // Sets the listener, which must outlive the port or be replaced. Call before anything else.
  void listen(PortListener& listener) { listener_ = &listener; }

  // Checks what can be checked without touching the device, and brings a passive port into being.
  virtual Result<void> prepare() = 0;

  // Begins a session: on_up() or on_down(failed) follows, now or later.
  virtual void open() = 0;
  // Ends it: unsent bytes are dropped (wait for on_drained() first where they matter). No on_down follows.
  virtual void close() = 0;

  // Takes all of `data`, as one datagram where the line has boundaries. What cannot be sent at once is kept:
  // the caller must stop writing while congested() is true, after the last datagram of an on_arrivals() that
  // it passes on. Bytes for a line that is not up are dropped.
  virtual void write(ByteView data) = 0;
  [[nodiscard]] virtual bool congested() const = 0;

  // No more bytes will be written until close(): the peer sees the end of what was sent, and may still send.
  // True: it will end the line itself (on_down) when it has sent all. False: the line has no half-close.
  virtual bool end_writing() = 0;

  // Bytes that were taken and that the peer has not read yet, as far as this machine knows; nothing where it
  // cannot be known. May cost a few system calls; after close() the bytes may be taken from the peer, which
  // counts them all.
  [[nodiscard]] virtual std::optional<std::size_t> unread_by_peer() const = 0;
  // The settings of a serial line; none where the line has no such thing.
  [[nodiscard]] virtual std::optional<LineSettings> settings() const { return std::nullopt; }
  // Changes them, before prepare() or at any time after it. Errc::usage where there are none; on an error
  // they stay. A line that is not up takes them when it comes up, or keeps the last that it took; one that is
  // up may take them only when what was written before has gone. What it took otherwise than asked for, a
  // line::Settings tells then. On a driver's port they are what the driver finds there: a pty shows them, and
  // is not made raw again.
  virtual Result<void> apply(const LineSettings&) {
    return make_error(Errc::usage, name() + " has no line settings");
  }
  // Something has happened at the line's other end, behind all that was written. The peer is to see it as far
  // as the line can show it; a port with a tape notes it, or compares it.
  // - LineSignal: a signal changes as the peer sees it: on a device's port dtr, rts and break, on a driver's
  //   port what the device drives. What a port does not drive is what its peer is shown instead of a
  //   device's. A line without such a thing, or that is not up, ignores it.
  // - line::Drain: line::Sent follows, from within or later, when all that was written has left for the
  //   device, or cannot any more, as the line is down. line::Ask: the device is asked, and line::Answer
  //   follows. Every port answers both, the line up or not, as long as it is there.
  // - line::Sent, line::Answer: the answers to what this port has told.
  // - line::Settings: the program at the other end has made its line so. Whether the device's line follows is
  //   apply()'s.
  // - line::WatchSignals: for a device's port.
  // - All others are for a port with a tape, or one that plays one.
  virtual void tell(const LineEvent& event);
  // Whether on_data may come: false is backpressure to the peer.
  virtual void set_reading(bool on) = 0;

  // Makes the peer see the line break, as an unplugged cable would; `after_reading`: once it has read what
  // was written.
  virtual void hang_up(bool after_reading) = 0;

  // Passes on what has come in by now and was not read yet, as far as reading is on; a passive port finds a
  // peer that nothing has told of yet. For the end of a session.
  virtual void read_pending() = 0;
  // Whether the peer has closed, or sends no more, and has left bytes that were not passed on yet.
  [[nodiscard]] virtual bool left_bytes() const { return false; }

  // The end of the program is near: completes what belongs to the session (tape, report). on_complete()
  // follows once, from within or later; a disk that does not answer delays it 10 s at most. The port may not
  // be opened again. Destroying it sooner gives up what is not complete, and tells that.
  virtual void finish() { listener().on_complete(0); }

  // What kind of line it is. While the port lives it changes only where that is said.
  [[nodiscard]] virtual PortTraits traits() const = 0;
  [[nodiscard]] bool passive() const { return traits().passive; }
  [[nodiscard]] bool keeps_datagrams() const { return traits().keeps_datagrams; }
  [[nodiscard]] bool has_half_close() const { return traits().has_half_close; }
  [[nodiscard]] bool shows_signals() const { return traits().shows_signals; }

  // What only some callers need, and only some ports have.
  [[nodiscard]] virtual PortFacets facets() { return {}; }
  [[nodiscard]] WaitingCalls* waiting() { return facets().waiting; }
  [[nodiscard]] Recorder* recorder() { return facets().recorder; }
  [[nodiscard]] Playback* playback_control() { return facets().playback; }
  [[nodiscard]] ConnectionSource* connections() { return facets().connections; }
  [[nodiscard]] SupervisedLine* supervised() { return facets().supervised; }

  static constexpr std::size_t kLargestDatagram = 65507;  // bytes in one of IPv4

  // For messages: `serial:/dev/ttyUSB0`.
  [[nodiscard]] virtual std::string name() const = 0;
  // Where a program finds it; a passive one from prepare() on, with what the system chose. One that connects:
  // where to. Empty where it is nowhere (a tape).
  [[nodiscard]] virtual PortPlace place() const { return {}; }
  // The identity of the device, for programs that list devices; from prepare() on. std::nullopt for a port
  // that is not a device, and for a device whose identity is unknown.
  [[nodiscard]] virtual std::optional<PortIdentity> identity() const { return std::nullopt; }

 protected:
  [[nodiscard]] PortListener& listener() const { return *listener_; }

 private:
  PortListener* listener_ = nullptr;
};

}  // namespace porttape
