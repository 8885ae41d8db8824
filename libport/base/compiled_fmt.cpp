#include "libport/base/compiled_fmt.hpp"

#ifdef PORTTAPE_COMPILED_FMT
PORTTAPE_COMPILED_FMT;
#endif
