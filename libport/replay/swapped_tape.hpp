#pragma once

#include <cstdint>

#include "libport/tape/event.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// A tape with its roles swapped, for one who plays the driver: what the driver wrote comes as reads, which
// are delivered, and what the device sent as writes, which are held against what comes. A half-close is the
// other side's, too, and so are the settings that the driver made; a device makes none by itself, so that its
// settings are nobody's. What the device sent while nobody had its line open is passed over: nobody has it
// open in the replay either.
//
// Refers to its source, which gives the whole tape. `writes_only`: for who compares.
class SwappedTape final : public RecordSource {
 public:
  enum class Select : std::uint8_t { merged, writes_only };

  explicit SwappedTape(RecordSource& source, Select select = Select::merged)
      : source_(source), select_(select) {}

  Result<std::optional<Record>> next() override;
  Result<void> rewind() override;

 private:
  void swap(Record& record);
  void swap_event(Record& record);

  RecordSource& source_;
  Select select_;
  bool closed_ = false;         // the walk is between a close and an open
  std::uint64_t left_out_ = 0;  // bytes of the device's
  Event event_;                 // the latest that is not as on the tape
};

}  // namespace porttape
