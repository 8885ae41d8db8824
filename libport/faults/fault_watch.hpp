#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "libport/faults/fault_plan.hpp"

namespace porttape {

// Where one fault strikes one stream of a line. What it finds hangs on the seed and on the bytes' places in
// the stream alone, not on how they are cut into arrivals; of Fault::When::time on when they come, too.
class FaultWatch {
 public:
  // A byte that is struck.
  struct Hit {
    std::size_t at = 0;     // in the arrival
    std::uint64_t nth = 0;  // of the strike, from 0 on
    bool last = false;      // of the strike
  };

  // `fault` outlives it; `index` is its place in the plan. In datagrams each arrival is a frame.
  FaultWatch(const Fault& fault, std::size_t index, std::uint64_t seed, LineDir dir, bool datagrams);

  // Looks at the next bytes of the stream; `elapsed` is Fault::at's time. Adds the hits, in order.
  void look(ByteView arrival, Nanos elapsed, std::vector<Hit>& hits);

  [[nodiscard]] std::uint64_t position() const { return position_; }
  // A number drawn for this byte of the stream: always the same one.
  [[nodiscard]] std::uint64_t drawn(std::uint64_t position) const;

 private:
  [[nodiscard]] bool passes_over(std::size_t bytes) const;
  [[nodiscard]] bool is_drawn(std::uint64_t number) const;
  [[nodiscard]] bool strikes(Nanos elapsed);
  void begin_frame();
  [[nodiscard]] bool ends_frame(Byte byte);

  const Fault* fault_;
  std::uint64_t base_;
  bool datagrams_;
  bool by_frames_;  // its strikes are counted in frames
  bool framed_;     // frames are to be found
  std::uint64_t position_ = 0;
  std::uint64_t strikes_ = 0;
  std::uint64_t left_ = 0;  // units of the strike
  std::uint64_t nth_ = 0;
  bool timed_out_ = false;   // Fault::at has been
  std::uint64_t frame_ = 0;  // the number of the frame
  std::uint64_t in_frame_ = 0;
  bool at_start_ = true;
  std::uint64_t strikes_at_ = 0;  // in this frame,
  bool armed_ = false;            // if at all
  std::size_t matched_ = 0;       // of the frame's end
};

}  // namespace porttape
