#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace porttape {

// The known word that was probably meant by a mistyped one: the one with the fewest letters left out, put in,
// exchanged with another or with their neighbour (Damerau and Levenshtein), whatever their case; at most one
// in a word of up to four letters, two up to eight, three in longer ones. Else the only one that begins with
// the word, of three letters or more.
std::optional<std::string_view> nearest(std::string_view word, std::span<const std::string_view> known);

// "; did you mean 'X'?", to end a message with; nothing where no word is near.
std::string did_you_mean(std::string_view word, std::span<const std::string_view> known);

}  // namespace porttape
