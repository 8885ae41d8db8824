#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "tools/tape_parts.hpp"

namespace porttape {

// How far a driver gets on a tape that answers whatever recorded request comes (match=lookup): which
// exchanges it has, in which order, and whether it asked what the tape has not. Give it the bytes as they
// pass.
class RequestTracker {
 public:
  // An exchange that the driver had, once more where it asked again; where its bytes began in both streams.
  struct Turn {
    std::size_t part = 0;
    std::uint64_t read = 0;
    std::uint64_t written = 0;
    friend bool operator==(const Turn&, const Turn&) = default;
  };

  // `exact`: requests are told by their bytes. Else each is the next one: a rules file lets them vary.
  RequestTracker(const std::vector<TapeParts::Part>& parts, bool exact);

  void driver_wrote(ByteView bytes);
  void driver_was_sent(ByteView bytes);

  [[nodiscard]] const std::vector<Turn>& turns() const { return turns_; }
  // Parts that it came to, one more when it wanted more than there is.
  [[nodiscard]] std::size_t reach() const { return next_ + (beyond_ ? 1 : 0); }
  // It asked what no part answers, or went on where all had been.
  [[nodiscard]] bool beyond() const { return beyond_; }
  // What it asked then; empty where that was known.
  [[nodiscard]] const Bytes& unknown() const { return unknown_; }

 private:
  enum class Fit { none, part_of, whole };
  [[nodiscard]] Fit fit(std::size_t part) const;
  bool take();
  void begin(std::size_t part, std::uint64_t written);

  const std::vector<TapeParts::Part>* parts_;
  bool exact_;
  std::size_t next_ = 0;  // the first part that it has not come to
  std::vector<Turn> turns_;
  Bytes pending_;  // of a request
  Bytes unknown_;
  bool beyond_ = false;
  bool lost_ = false;  // what it asks is not known, up to the next answer
  bool asks_ = false;  // it spoke last
  std::uint64_t read_ = 0;
  std::uint64_t written_ = 0;
};

}  // namespace porttape
