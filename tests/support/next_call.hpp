#pragma once

#include <cstring>
#include <dlfcn.h>

namespace porttape {

// The C library's own function, for code that stands in for it.
template <class Function>
Function next_call(const char* name) {
  void* const symbol = ::dlsym(RTLD_NEXT, name);
  Function function = nullptr;
  std::memcpy(&function, &symbol, sizeof function);
  return function;
}

}  // namespace porttape
