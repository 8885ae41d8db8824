#include "tools/verb_clock.hpp"

namespace porttape {

const Clock& verb_clock() { return machine_clock(); }

}  // namespace porttape
