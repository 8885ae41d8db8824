#pragma once

#include <string>
#include <string_view>

namespace porttape {

// UTF-8 text in which nothing is left that a terminal or a log would obey instead of showing: C0 and C1
// controls, DEL, marks that change the direction of text, line and paragraph separators. They become \n, \r,
// \t, \xNN (below U+0100) or \u{NNNN}; bytes that are no UTF-8 become \xNN. Everything else stays readable.
//
// A backslash stays as it is: what comes out is for eyes, not to be read back.
std::string printable_line(std::string_view text);

// The same, with line feeds kept: a line after the first begins with a space, so that none can pass for a
// message of its own.
std::string printable_lines(std::string_view text);

// A name from outside as every message has it: in single quotes, printable_line().
std::string in_quotes(std::string_view name);

// A word as a POSIX shell reads it: in quotes where it needs them. A word with something that a terminal
// would obey is written in $'…', which POSIX has since 2024 and bash, zsh and ksh had before; another shell
// takes it for one word, too.
std::string shell_word(std::string_view word);

// Whether a character would be obeyed; printable_line() and json_quote() escape these.
bool is_obeyed(char32_t character);

}  // namespace porttape
