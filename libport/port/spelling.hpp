#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port_type.hpp"

namespace porttape {

// flexiport's option strings are separated by these.
inline constexpr std::string_view kSeparators = ", \t\n";

// The parts of a text between any of the separators, empty ones left out.
std::vector<std::string_view> split_tokens(std::string_view text, std::string_view separators);

// `key=value` or a bare key, which turns a boolean option on.
std::pair<std::string, std::string> split_option(std::string_view token);

// Whether a text has `type=`, or begins with the name of a type or with /dev/.
bool names_type(const PortTypes& types, std::string_view spec);

// `type=TYPE,option=value…` or `TYPE:MAIN[,option=value…]` as options with the type among them; unchecked, an
// unknown type is left for check_options(). Main parts: `tcp:HOST`, `tcp:HOST:PORT`, `tcp:[::1]:PORT`,
// `tcp-listen:PORT`, `unix:/path`, `/dev/…`. Errc::usage for nothing at all, for a main part that cannot be
// taken apart, and for an empty part of the short spelling in whose place a default would be taken.
Result<OptionValues> read_spelling(const PortTypes& types, std::string_view spec);

// See PortOptions::name() and spelled().
std::string short_name(const PortOptions& options);
std::string short_spelling(const PortOptions& options);

// `HOST:PORT`, an IPv6 address in brackets.
std::string host_and_port(std::string_view host, long port);

}  // namespace porttape
