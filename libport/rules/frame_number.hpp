#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/rules/rule_set.hpp"

namespace porttape {

// The number that a field holds, of the rule's type and order; nothing: it holds none.
std::optional<double> real_number(const Rule& rule, ByteView field);
std::optional<std::uint64_t> whole_number_in(const Rule& rule, ByteView field);

// What a counter in a field of `size` bytes is, so much beyond `value`; it begins again where the field or
// the rule's modulo ends.
std::uint64_t counted_on(const Rule& rule, std::size_t size, std::uint64_t value, std::uint64_t more);

}  // namespace porttape
