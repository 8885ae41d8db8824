#pragma once

#include <fmt/format.h>

// Included ahead of every source in a unity build (CMakeLists.txt): what nearly every source with a log or a
// message needs of fmt is compiled once, in compiled_fmt.cpp, and not in each of them, where it is a third of
// the work. fmt 9 leaves it out of its own `extern template` declarations.
#if FMT_VERSION / 10000 == 9 && !defined(FMT_HEADER_ONLY)
#define PORTTAPE_COMPILED_FMT                                                                           \
  template void fmt::detail::vformat_to<char>(fmt::detail::buffer<char>&, fmt::basic_string_view<char>, \
                                              fmt::basic_format_args<FMT_BUFFER_CONTEXT(char)>,         \
                                              fmt::detail::locale_ref)
extern PORTTAPE_COMPILED_FMT;
#endif
