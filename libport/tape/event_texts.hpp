#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>

namespace porttape {

// Given a text's key ("text", "identity.serial") and the text; gives what is to stand there.
using TextChange = std::function<std::string(std::string_view key, std::string_view text)>;

// A line of the events file (header or event, without its newline) with its free texts changed, those of
// unknown kinds and keys too. What is a word of the format (kinds, directions, ids, times) is no text. A line
// in which nothing changes stays as it is.
std::string change_texts(std::string_view line, const TextChange& change);

// The line without what tells of the machine: `host`, `identity`, and the zero's `boot`.
std::string without_identity(std::string_view line);

}  // namespace porttape
