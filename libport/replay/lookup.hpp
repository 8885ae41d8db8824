#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/answer_player.hpp"
#include "libport/replay/engine.hpp"
#include "libport/replay/pieces.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/request_index.hpp"
#include "libport/replay/request_matcher.hpp"

namespace porttape {

// Answers what the driver asks for, in whatever order. match=lookup: all of the tape's requests, in recorded
// order where there are several answers, then the last again. on-mismatch=resync, from go_on_from() on: of
// several answers the nearest that follows on the tape, or else the nearest before; what is not the tape's
// next request is a mismatch. What nobody asked for is a Player's (see Unasked).
//
// Drive it: begin_run(), begin_session() at each open of the driver, write() and then find() until it gives
// nothing; play() as time goes on, and find() again. Refers to all that it is given, which must outlive it.
class Lookup {
 public:
  // `replies`: null where answers are as recorded.
  Lookup(const ReplayConfig& config, const Engine::TapeFacts& facts, const Engine::Parts& parts,
         Budget& budget, Pieces& pieces, const ReplayClock& clock, Replies* replies);

  void begin_run();
  // The same, but no request is played anew: each gets the last of its answers.
  void begin_behind_end();
  // The tape is at `position` of its writes, in the request that is next, and the driver has written `offset`
  // bytes; what it writes then is a mismatch that was told. write() follows with that, and before it the last
  // `known` bytes, some of which may belong to that request.
  void go_on_from(std::uint64_t position, std::uint64_t offset, std::size_t known);
  // Where the tape has gone on since, for a person; once.
  [[nodiscard]] std::string take_went_on() { return std::exchange(went_on_, {}); }
  // What the last session left is gone.
  void begin_session();

  // Whether it should be given writes: the tape is read through, and no more answers wait than it keeps
  // apart.
  [[nodiscard]] bool ready() { return index_.read_on() && !player_.full(); }
  void write(Instant now, ByteView data);
  // The driver pauses: what is complete now need not go on.
  [[nodiscard]] std::optional<Instant> pause_due() const { return matcher_.pause_due(); }
  void pause() { matcher_.pause(); }
  // Takes up what was asked for. Bytes that are no request of the tape's are a mismatch; call again then.
  // What is of a run is left to the caller.
  [[nodiscard]] std::optional<Mismatch> find();

  // Reads the tape through, and delivers what is due.
  void play(Instant now, std::size_t max_bytes, bool blocked, ReplayActions& out);

  AnswerPlayer& player() { return player_; }
  [[nodiscard]] const AnswerPlayer& player() const { return player_; }
  // Every recorded request was asked for as often as it stands on the tape, or after go_on_from() the last
  // one, and is answered.
  [[nodiscard]] bool used_up() const {
    const std::uint64_t done = from_ ? next_ : played_;
    return index_.whole() && done == index_.exchanges() && player_.idle();
  }
  // Bytes of the driver's in this run.
  [[nodiscard]] std::uint64_t written() const { return matcher_.written(); }

  // The driver left off inside a request.
  [[nodiscard]] bool cut_off();
  // Into the report of a run that ends.
  void report(RunReport& report) const;
  [[nodiscard]] const std::optional<Error>& error() const {
    return index_.error() ? index_.error() : player_.error();
  }

 private:
  struct OfKind {
    std::uint32_t next = RequestIndex::kNone;  // exchange
    std::uint64_t asked = 0;
  };
  // A request that was not finished.
  struct CutOff {
    Bytes came;
    Bytes rest;
    RequestMatcher::Nearest place{};
  };

  void begin_books();
  void begin_on_index();
  std::optional<Mismatch> answer(const RequestMatcher::Step& step);
  void ask_for(std::uint32_t exchange, std::uint64_t again, const RequestMatcher::Step& step);
  std::optional<Mismatch> answer_nearest(const RequestMatcher::Step& step);
  [[nodiscard]] std::uint32_t nearest(const RequestMatcher::Step& step) const;
  [[nodiscard]] Mismatch unknown() const;
  [[nodiscard]] Mismatch expected(std::uint32_t exchange, std::size_t recorded, std::size_t came) const;
  void note_cut_off();

  RequestIndex index_;
  RequestMatcher matcher_;
  AnswerPlayer player_;
  bool keeps_requests_;

  std::vector<OfKind> kinds_;
  std::uint64_t played_ = 0;  // exchanges, each once
  std::uint64_t answered_ = 0;
  std::uint64_t unknown_ = 0;
  std::uint64_t matched_ = 0;
  std::optional<CutOff> cut_off_;

  // After go_on_from().
  std::optional<std::uint64_t> from_;  // of the tape's writes
  std::size_t known_ = 0;              // bytes of what came first that went with the tape
  std::uint32_t next_ = 0;             // exchange
  bool told_ = false;                  // what comes now is known to be a mismatch
  std::string went_on_;
};

}  // namespace porttape
