#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace porttape {

// Given a text's key ("text", "identity.serial") and the text; gives what is to stand there.
using TextChange = std::function<std::string(std::string_view key, std::string_view text)>;

// What of a line cannot be changed, and is no part of the format: a number, the name of a key, an event's
// kind.
enum class FixedText : std::uint8_t { number, key, kind };
// `key` is the number's; of a key's name, the one that it stands in, which may be empty.
using FixedLook = std::function<void(FixedText what, std::string_view key, std::string_view text)>;

// A line of the events file (header or event, without its newline) with its texts changed, those of unknown
// kinds and keys too. What is a word of the format in its place (event_words.hpp) is none. What cannot be
// changed is shown to `look`. A line in which nothing changes stays as it is.
std::string change_texts(std::string_view line, const TextChange& change, const FixedLook& look = {});

// Visits each string of a line, words of the format too, but no key.
void each_text(std::string_view line, const std::function<void(std::string_view text)>& visit);

// The line without what tells of the machine: `host`, `identity`, and the zero's `boot`.
std::string without_identity(std::string_view line);

}  // namespace porttape
