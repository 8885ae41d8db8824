#include "libport/archive/lib_archive.hpp"

#include <dlfcn.h>
#include <string>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr const char* kName = "libarchive.so.13";  // of every libarchive 3

Error unusable(const char* why) {
  return make_error(Errc::io, std::string("archives need the library ") + kName +
                                  ", which cannot be loaded: " + printable_line(why == nullptr ? "?" : why) +
                                  "; install it (Debian: libarchive13)");
}

Result<LibArchive> load() {
  void* const library = ::dlopen(kName, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) return unusable(::dlerror());
  LibArchive calls;
#define PORTTAPE_LOAD(name)                                                     \
  calls.name = reinterpret_cast<decltype(calls.name)>(::dlsym(library, #name)); \
  if (calls.name == nullptr) return unusable(::dlerror());
  PORTTAPE_LIBARCHIVE_CALLS(PORTTAPE_LOAD)
#undef PORTTAPE_LOAD
  return calls;
}

}  // namespace

const Result<LibArchive>& load_libarchive() {
  static const Result<LibArchive> loaded = load();
  return loaded;
}

const LibArchive& libarchive() { return *load_libarchive(); }

}  // namespace porttape
