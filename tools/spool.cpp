#include "tools/spool.hpp"

#include <cerrno>
#include <cstdlib>
#include <sys/mman.h>
#include <unistd.h>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr std::size_t kInMemory = std::size_t{1} << 20;

}  // namespace

Spool::~Spool() {
  if (mapped_ != nullptr) ::munmap(mapped_, written_);
}

void Spool::add(std::string_view text) {
  if (error_ != 0) return;
  kept_ += text;
  if (kept_.size() >= kInMemory) flush();
}

void Spool::flush() {
  if (!file_) {
    const char* folder = std::getenv("TMPDIR");
    std::string name =
        std::string(folder != nullptr && *folder != '\0' ? folder : "/tmp") + "/porttape-XXXXXX";
    file_ = UniqueFd(::mkostemp(name.data(), 02000000));  // O_CLOEXEC
    if (!file_) {
      error_ = errno;
      return;
    }
    ::unlink(name.c_str());
  }
  std::string_view rest = kept_;
  while (!rest.empty()) {
    const ssize_t done = ::write(file_.get(), rest.data(), rest.size());
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) {
      error_ = errno;
      return;
    }
    written_ += static_cast<std::size_t>(done);
    rest.remove_prefix(static_cast<std::size_t>(done));
  }
  kept_.clear();
}

Result<std::string_view> Spool::text() {
  if (error_ == 0 && file_ && mapped_ == nullptr) {
    flush();
    void* const mapped =
        error_ == 0 ? ::mmap(nullptr, written_, PROT_READ, MAP_PRIVATE, file_.get(), 0) : nullptr;
    if (mapped == MAP_FAILED) error_ = errno;
    if (error_ == 0) mapped_ = mapped;
  }
  if (error_ != 0)
    return make_error(
        Errc::io, "a temporary file for the report: " + errno_text(error_) + "; TMPDIR names another folder");
  if (mapped_ == nullptr) return std::string_view(kept_);
  return std::string_view(static_cast<const char*>(mapped_), written_);
}

}  // namespace porttape
