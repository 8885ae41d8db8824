#pragma once

#include <string_view>

namespace porttape {

// The words of the events file (FORMAT.md), by which they are told from what somebody has said. `kind` is an
// event's, or kHeader; `path` names a key with those it is in: "zero.wall".
namespace event_words {

inline constexpr std::string_view kHeader = "";

bool is_known_kind(std::string_view kind);
bool is_known_key(std::string_view kind, std::string_view key);
// Its value is a number that the recorder made.
bool is_known_number(std::string_view kind, std::string_view key);
// One of the few words that can stand there, or an id, a digest or a time of the form that it has there.
bool is_word(std::string_view kind, std::string_view path, std::string_view text);

}  // namespace event_words
}  // namespace porttape
