#include "libport/formats/spilled_bytes.hpp"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <stdlib.h>
#include <string>
#include <unistd.h>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostKept = std::size_t{1} << 20U;
constexpr std::size_t kPieceOfFile = std::size_t{64} * 1024;

Error spill_trouble(int error) {
  std::error_code ignored;
  return make_error(Errc::io, fmt::format("a temporary file in {}: {}",
                                          in_quotes(std::filesystem::temp_directory_path(ignored).string()),
                                          errno_text(error)));
}

Result<UniqueFd> temporary_file() {
  std::error_code ignored;
  std::string path = (std::filesystem::temp_directory_path(ignored) / "porttape-XXXXXX").string();
  UniqueFd fd(::mkostemp(path.data(), O_CLOEXEC));
  if (!fd) return spill_trouble(errno);
  (void)::unlink(path.c_str());
  return fd;
}

}  // namespace

Result<void> SpilledBytes::add(ByteView bytes) {
  append(kept_, bytes);
  return kept_.size() > kMostKept ? spill() : Result<void>();
}

Result<void> SpilledBytes::spill() {
  if (!fd_) {
    Result<UniqueFd> file = temporary_file();
    if (!file) return file.error();
    fd_ = std::move(*file);
  }
  for (ByteView left = kept_; !left.empty();) {
    const ssize_t size = ::pwrite(fd_.get(), left.data(), left.size(), static_cast<off_t>(in_file_));
    if (size < 0 && errno == EINTR) continue;
    if (size < 0) return spill_trouble(errno);
    in_file_ += static_cast<std::uint64_t>(size);
    left = left.subspan(static_cast<std::size_t>(size));
  }
  kept_.clear();
  return {};
}

Result<void> SpilledBytes::each_piece(const std::function<Result<void>(ByteView piece)>& take) const {
  Bytes piece(std::min<std::uint64_t>(in_file_, kPieceOfFile));
  for (std::uint64_t at = 0; at < in_file_;) {
    const ssize_t size = ::pread(fd_.get(), piece.data(), piece.size(), static_cast<off_t>(at));
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0) return spill_trouble(size < 0 ? errno : EIO);
    if (Result<void> taken = take(ByteView(piece).first(static_cast<std::size_t>(size))); !taken)
      return taken;
    at += static_cast<std::uint64_t>(size);
  }
  return kept_.empty() ? Result<void>() : take(kept_);
}

void SpilledBytes::clear() {
  kept_.clear();
  fd_.reset();
  in_file_ = 0;
}

}  // namespace porttape
