#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "tests/simulation/line.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// Whether `part` is `whole` less some of its bytes.
bool is_subsequence(ByteView part, ByteView whole);

// All bytes of one direction.
Bytes joined(std::span<const Passed> passed, bool to_listener);

// Reports where `to` was given what `from` did not give, or gave in another order. Bytes may be missing, and
// of datagrams only whole ones where `whole` is true.
void check_passes(World& world, const Line& from, const Line& to, bool whole = true);

// Bytes that came from either side and were given to neither.
std::uint64_t lost_between(const Line& driver, const Line& device);

// The sum of the numbers before any of `texts` in what the logger `who` has told.
std::uint64_t told_by(const World& world, const std::string& who,
                      std::initializer_list<std::string_view> texts);

}  // namespace porttape::simulation
