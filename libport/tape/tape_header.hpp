#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/clock.hpp"
#include "libport/base/port_identity.hpp"
#include "libport/base/stranger_text.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// A tape's zero on the clocks of the machine that recorded it.
struct TapeZero {
  StrangerText wall;              // RFC 3339 with microseconds
  std::int64_t monotonic_us = 0;  // of CLOCK_MONOTONIC, since that boot
  StrangerText boot;              // which boot of which machine; empty where it is not known

  friend bool operator==(const TapeZero&, const TapeZero&) = default;
};

// RFC 3339 with microseconds: the time of day at the moment `at` of that clock.
std::string wall_text(Instant at, const Clock& clock);
// The same of a time since 1970.
std::string wall_text(Micros since_1970);
// The moment `zero` of that clock, as a header has it.
TapeZero tape_zero(Instant zero, const Clock& clock);

// How much later than `first` it was: by the monotonic clock where both are of one boot, else by the wall's.
// Nothing where that is not known.
std::optional<Micros> since(const TapeZero& first, const TapeZero& zero);

// The clocks so much later.
TapeZero later(TapeZero zero, Micros by);

enum class Transport : std::uint8_t { stream, datagram };
// When a block got its time: when its bytes came, or when a program that does not listen all the time read
// them.
enum class Stamped : std::uint8_t { arrival, read };

// The tape before this one, of a rotation.
struct PreviousTape {
  StrangerText id;
  StrangerText name;

  friend bool operator==(const PreviousTape&, const PreviousTape&) = default;
};

// What a tape was made of, by a verb.
struct TapeOrigin {
  StrangerText by;                  // the verb: "cut"
  std::vector<PreviousTape> tapes;  // at least one; those without an events file have no id
  std::optional<Micros> from;       // when it begins on the time of the first of them

  friend bool operator==(const TapeOrigin&, const TapeOrigin&) = default;
};

// What the header line of the events file says. What is empty is not told; the writer fills in what it knows
// itself.
struct TapeHeader {
  StrangerText device;  // the port with every option that the user gave
  StrangerText driver;
  StrangerText created{};  // RFC 3339; written: now
  StrangerText host{};     // written: this machine's name
  StrangerText tool{};     // written: "porttape VERSION"
  StrangerText id{};       // 32 hexadecimal digits, one a tape; written: random ones
  std::optional<TapeZero> zero{};
  std::optional<Transport> transport{};
  std::optional<Stamped> stamped{};
  std::optional<PreviousTape> previous{};
  std::optional<PortIdentity> identity{};  // of the device; without its location
  StrangerText identity_refused{};         // read: why the header's identity is none (check_identity)
  std::optional<TapeOrigin> origin{};

  friend bool operator==(const TapeHeader&, const TapeHeader&) = default;
};

// The header with what a writer fills in.
TapeHeader completed(TapeHeader header);

}  // namespace porttape
