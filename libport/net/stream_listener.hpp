#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>

#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/timer.hpp"
#include "libport/net/tcp_peer.hpp"
#include "libport/port/context.hpp"

namespace porttape {

// A listening stream socket: accepts who connects, and lets them in one after the other.
//
// Who finds nobody inside is let in at once. While somebody is there a newcomer is refused: its connection is
// reset, and the log says who it was. Where the one before it has ended its connection (it may still wait for
// answers, or have left bytes that are to be read) the newcomer waits for its turn. One that goes away while
// it waits is told in the log, and what it wrote reaches nobody.
//
// The end of a connection and the next one may come in either order: a newcomer is refused 20 ms after it
// came, if the one before it is there still. At most kMostWaiting wait.
//
// In a program that waits in its calls (PortContext::pulled) nobody is refused: newcomers stay with the
// kernel until the one inside has gone.
//
// Owns the socket. Drive it: accept(true), left() when the one inside has gone. Loop thread only.
class StreamListener {
 public:
  enum class Inside { nobody, ended, there };

  // Who has the listener, and the one inside.
  class Owner {
   public:
    // Who is inside. What can be known of its end is looked at before.
    [[nodiscard]] virtual Inside inside() = 0;
    // Takes a connection; `who`, for messages, is at its other end.
    virtual void let_in(UniqueFd fd, const std::string& who) = 0;
    [[nodiscard]] virtual PeerState look_at_peer(int fd) = 0;
    // A newcomer was turned away with so many bytes that it had written.
    virtual void refused(std::uint64_t bytes) = 0;

   protected:
    ~Owner() = default;
  };

  static constexpr Nanos kSettling = std::chrono::milliseconds(20);
  static constexpr std::size_t kMostWaiting = 16;
  static constexpr int kBacklog = 128;  // of the socket, for listen()

  // `name` is for messages; `owner` must outlive the listener.
  StreamListener(const PortContext& context, Owner& owner, std::string name, UniqueFd fd);

  // False: newcomers stay with the kernel, who waits here is turned away, and the one inside is gone.
  void accept(bool on);
  // The one inside has gone: the next one is let in, on a later turn of the loop. Who waited and has gone by
  // now is told before this returns.
  void left();
  // Whether somebody waits who is there.
  [[nodiscard]] bool next_waits();

 private:
  struct Newcomer {
    UniqueFd fd;
    std::string who;
    Instant since{};
    bool told = false;  // that it waits
  };

  void watch();
  void let_in(Newcomer newcomer);
  void on_acceptable();
  void not_accepted(int error_number);
  void newcomer(Newcomer newcomer);
  void drop_all_gone();
  void let_next_in();
  void look();
  [[nodiscard]] bool is_gone(int fd);
  void drop_gone(Newcomer& newcomer);
  void refuse(Newcomer& newcomer, const std::string& why);
  void tell_refused();

  PortContext context_;
  Owner* owner_;
  const std::string name_;
  UniqueFd fd_;
  FdWatch watch_;
  std::deque<Newcomer> waiting_;
  std::string inside_;  // who was let in last
  Timer look_timer_;
  Timer accept_timer_;  // the next accept after a failure
  Timer tell_timer_;
  bool accepts_ = false;
  bool taken_ = false;                                    // somebody was let in, and has not left
  int told_error_ = 0;                                    // of accept(), until one succeeds
  std::uint64_t not_told_ = 0;                            // refused since the last line about that
  std::shared_ptr<int> alive_ = std::make_shared<int>();  // for tasks posted to the loop
};

// Closes a connection so that its peer sees a reset, where its kind has such a thing.
void reset_connection(UniqueFd fd);

}  // namespace porttape
