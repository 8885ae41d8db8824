#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace porttape {

struct RunReport;

// Why a run is not as recorded, in a sentence, as far as tape and run show it. Plain value.
struct Cause {
  enum class Kind : std::uint8_t {
    left_out,         // requests of the tape never came, later ones did
    swapped,          // two requests in the other order
    early,            // a later request came, and what became of those before is not known
    twice,            // the request before once more
    again,            // one that is further back
    terminator,       // its line end is missing, or another
    byte_more,        // or several
    byte_less,        //
    letter_case,      //
    checksum,         //
    off_by_one,       // a number, or a length
    changed,          // other bytes
    unknown_request,  // that the tape has not here, in another's place or before it
    at_end,           // more than the tape has
    cut_short,        // a request began and did not end
    stopped,          // the driver ended (or its line did) before the next request
    hung,             // it did nothing more and did not end
    gave_up,          // it ended before its answer had come
    late,             // a request, by the clock
    too_soon,         // the same the other way
    not_awaited,      // a request before the answer to the last one was there
    own_lateness,     // this program was late itself
    read_sizes,       // the answers were cut otherwise than recorded
    unread            // it left bytes of an answer
  };

  Kind kind = Kind::changed;
  bool certain = false;  // else the text says `looks like`
  std::string text;
  std::optional<std::uint64_t> request = {};  // the exchange of the tape that it is about

  friend bool operator==(const Cause&, const Cause&) = default;
};

// "left-out", … as JSON has it.
std::string_view to_string(Cause::Kind kind);

// What the report and its excerpt show. Nothing where all is as recorded, and where they do not show more
// than the report says already.
std::optional<Cause> find_cause(const RunReport& report);

}  // namespace porttape
