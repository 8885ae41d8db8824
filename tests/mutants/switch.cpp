#include "tests/mutants/switch.hpp"

#include <cstdlib>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace porttape_mutants {

int active = 0;
unsigned char* reached = nullptr;

namespace {

// Runs before every static initialiser, which may hold a mutant itself. It makes its calls to the system
// directly, since the simulation replaces the C library's functions.
[[gnu::constructor(101)]] void read_environment() {
  if (const char* const number = std::getenv("PORTTAPE_MUTANT")) active = std::atoi(number);
  const char* const path = std::getenv("PORTTAPE_MUTANT_REACHED");
  if (path == nullptr) return;
  const long file = ::syscall(SYS_openat, AT_FDCWD, path, O_RDWR | O_CLOEXEC);
  if (file < 0) return;
  const long size = ::syscall(SYS_lseek, file, 0, SEEK_END);
  // A shared mapping: what a process has reached stays in the file when the process is killed.
  const long place =
      size <= 0 ? -1 : ::syscall(SYS_mmap, nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  ::syscall(SYS_close, file);
  if (place != -1) reached = reinterpret_cast<unsigned char*>(place);
}

}  // namespace
}  // namespace porttape_mutants
