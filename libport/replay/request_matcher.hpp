#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/expectation.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/request_index.hpp"

namespace porttape {

// Finds the requests of an index in what the driver writes, as one stream: how it is cut never matters, but
// for one thing. A request that is the beginning of a longer one is complete when what comes next does not go
// on with the longer one, or when the driver pauses behind it for `gap`. A field that an expectation leaves
// open ends so too.
//
// Bytes that begin no request are unknown: told once, and passed over up to the driver's next pause, or,
// where it `tries_all`, up to the next that begins one.
//
// Drive it: add() what comes, then next() until it gives `taken`; the same after pause(), which is due at
// pause_due(). What the clock is moved by hand is no pause. Refers to the index, which must be whole, and to
// the clock; both must outlive it. Keeps no more of the driver's than the longest request and one write.
class RequestMatcher {
 public:
  enum class Outcome : std::uint8_t { taken, request, unknown };
  struct Step {
    Outcome outcome = Outcome::taken;
    // request: of these kinds (several where an expectation lets them look alike), so many bytes from the
    // front of text(), the last of which came at `completed`. drop() takes them away; next() follows.
    std::vector<std::uint32_t> kinds{};
    std::size_t size = 0;
    Instant completed{};
  };
  // What was nearest to unknown bytes, or to those of a request that is not complete.
  struct Nearest {
    std::uint32_t exchange = RequestIndex::kNone;
    std::size_t recorded = 0;  // bytes of its request
    std::size_t came = 0;      // and of text() that go together
  };

  RequestMatcher(const RequestIndex& index, const Expectation* expectation, const ReplayClock& clock,
                 Micros gap, bool tries_all)
      : index_(index), expectation_(expectation), clock_(clock), gap_(gap), tries_all_(tries_all) {}

  // Forgets all that came; what comes now is at `offset` of all that the driver wrote. `lost`: that it begins
  // with what is unknown has been told.
  void begin(std::uint64_t offset = 0, bool lost = false);
  // Looks anew at what is not settled: once the index is whole.
  void restart();
  void add(Instant now, ByteView data);
  [[nodiscard]] Step next();
  void pause() {
    paused_ = true;
    pause_told_ = offset_ + text().size();
  }
  [[nodiscard]] std::optional<Instant> pause_due() const;

  // What is not settled: of the request that may be under way. After `unknown`: what begins with the unknown
  // bytes.
  [[nodiscard]] ByteView text() const { return ByteView(text_).subspan(front_); }
  [[nodiscard]] std::uint64_t text_offset() const { return offset_; }  // in all that the driver wrote
  [[nodiscard]] std::uint64_t written() const { return offset_ + text().size(); }
  // Of text(); after `unknown` of the unknown bytes.
  [[nodiscard]] const Nearest& nearest() const { return nearest_; }
  void drop(std::size_t count);
  // Whether text() is whole frames that may be repeated, and nothing of a request.
  [[nodiscard]] bool between() const;

 private:
  struct Stamp {
    std::uint64_t end = 0;  // in all that the driver wrote
    Instant at{};
  };
  // A kind that text() may be of, as far as is known.
  struct Trial {
    std::uint32_t kind = 0;
    Comparison comparison{};
    std::size_t recorded = 0;
    std::size_t came = 0;
    bool goes_on = false;
    bool open = false;
  };

  void look();
  void look_plain();
  void look_by_expectation();
  bool advance(Trial& trial, bool pauses);
  void found(std::uint32_t kind, std::size_t size);
  void came_near(std::uint32_t kind, std::size_t recorded, std::size_t came);
  [[nodiscard]] Instant came_at(std::uint64_t offset) const;

  const RequestIndex& index_;
  const Expectation* expectation_;
  const ReplayClock& clock_;
  Nanos gap_;
  bool tries_all_;

  Bytes text_;
  std::size_t front_ = 0;     // of text_
  std::uint64_t offset_ = 0;  // of the front
  std::deque<Stamp> stamps_;
  Instant last_write_{};
  bool paused_ = false;
  std::uint64_t pause_told_ = 0;  // behind so many bytes of the driver's
  bool lost_ = false;             // among unknown bytes

  // Of the requests that text() may be: is one of them longer than what came, and which are complete.
  bool alive_ = false;
  std::vector<std::uint32_t> complete_;
  std::size_t complete_size_ = 0;
  Nearest nearest_;
  std::size_t low_ = 0;  // without an expectation: those of the sorted kinds
  std::size_t high_ = 0;
  std::size_t depth_ = 0;
  std::vector<Trial> trials_;  // with one
};

}  // namespace porttape
