#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "libport/base/clock.hpp"

namespace boost::asio {
class io_context;
}

namespace porttape {

// The moments at which a loop has to call back, by one clock: earliest first, equal ones in the order in
// which they were put in. One wait of the loop's io_context serves them all, and io_context::run() does not
// return while there are any. Owned by a Loop; Timer is what others use. Loop thread only.
class TimerQueue {
 public:
  // A moment; the number orders entries of the same moment.
  using Place = std::pair<Instant, std::uint64_t>;

  class Entry {
   public:
    virtual ~Entry() = default;
    // The moment of this place has come; the entry has left the queue. Each entry has a handler of its own,
    // so that an exception out of one does not lose the others: the place may have been given up meanwhile.
    // It must not run the loop.
    virtual void on_due(const Place& place) = 0;
  };

  // Until close() the queue uses `io`; the clock outlives the queue.
  TimerQueue(boost::asio::io_context& io, const Clock& clock);
  ~TimerQueue();
  // From here on no moment comes. Handlers that go with the io_context may still put and remove entries.
  void close();
  TimerQueue(const TimerQueue&) = delete;
  TimerQueue& operator=(const TimerQueue&) = delete;

  [[nodiscard]] const Clock& clock() const { return clock_; }
  Place put(Instant when, std::shared_ptr<Entry> entry);
  // No effect where the place's moment has come already.
  void remove(const Place& place);
  [[nodiscard]] std::optional<Instant> earliest() const;
  // To be called when a clock that does not pass by itself was moved.
  void clock_moved() { arm(); }

 private:
  struct Wait;

  void arm();
  void wake();

  boost::asio::io_context& io_;
  const Clock& clock_;
  std::unique_ptr<Wait> wait_;  // nullptr once it is closed
  std::map<Place, std::shared_ptr<Entry>> entries_;
  std::uint64_t next_number_ = 0;
  // When the wait ends, by the machine's clock: it may be earlier than needed, never later.
  std::optional<Instant> armed_;
  std::uint64_t round_ = 0;  // recognises a wait that was replaced while its end was already queued
};

}  // namespace porttape
