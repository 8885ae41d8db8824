#include "libport/base/version.hpp"

namespace porttape {

std::string_view version() { return PORTTAPE_VERSION; }

}  // namespace porttape
