#include "libport/formats/evidence.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "libport/base/printable.hpp"

namespace porttape {

Result<Evidence> Evidence::open(const std::string& path) {
  if (path == "-") return Evidence("stdin", UniqueFd(::fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3)));
  UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY));
  struct stat status {};
  if (!fd || ::fstat(fd.get(), &status) != 0)
    return make_error(Errc::usage, fmt::format("{} cannot be read: {}", in_quotes(path), errno_text(errno)));
  if (S_ISDIR(status.st_mode)) return make_error(Errc::usage, in_quotes(path) + " is a folder; name a file");
  Evidence evidence(path, std::move(fd));
  if (S_ISREG(status.st_mode)) evidence.size_ = static_cast<std::uint64_t>(status.st_size);
  return evidence;
}

Evidence Evidence::of(std::string name, std::string_view bytes) {
  Evidence evidence(std::move(name), UniqueFd());
  evidence.buffer_.assign(bytes.begin(), bytes.end());
  evidence.size_ = bytes.size();
  evidence.ended_ = true;
  return evidence;
}

// Until so much is kept, or it ends.
Result<void> Evidence::fill(std::size_t wanted) {
  if (!trouble_.empty()) return make_error(Errc::io, trouble_);
  if (kept() >= wanted || ended_) return {};
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(begin_));
  begin_ = 0;
  while (buffer_.size() < wanted && !ended_) {
    const std::size_t had = buffer_.size();
    buffer_.resize(had + std::max(wanted - had, kPeeked));
    ssize_t size = 0;
    do {
      size = ::read(fd_.get(), buffer_.data() + had, buffer_.size() - had);
    } while (size < 0 && errno == EINTR);
    const int error = errno;
    buffer_.resize(had + static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    ended_ = size == 0;
    if (size < 0) {
      trouble_ = fmt::format("{} cannot be read: {}", in_quotes(name_), errno_text(error));
      return make_error(Errc::io, trouble_);
    }
  }
  return {};
}

void Evidence::take(std::size_t bytes) {
  begin_ += bytes;
  offset_ += bytes;
}

Result<ByteView> Evidence::peek(std::size_t most) {
  most = std::min(most, kPeeked);
  if (const auto filled = fill(most); !filled) return filled.error();
  return ByteView(buffer_).subspan(begin_, std::min(most, kept()));
}

Result<std::size_t> Evidence::read(std::span<Byte> into) {
  std::size_t done = 0;
  while (done < into.size()) {
    const std::size_t wanted = std::min(into.size() - done, kPeeked);
    if (const auto filled = fill(wanted); !filled) return filled.error();
    const std::size_t size = std::min(into.size() - done, kept());
    if (size == 0) break;
    std::memcpy(into.data() + done, buffer_.data() + begin_, size);
    take(size);
    done += size;
  }
  return done;
}

Result<std::uint64_t> Evidence::skip(std::uint64_t bytes) {
  std::uint64_t done = 0;
  while (done < bytes) {
    if (const auto filled = fill(1); !filled) return filled.error();
    const std::uint64_t size = std::min<std::uint64_t>(bytes - done, kept());
    if (size == 0) break;
    take(size);
    done += size;
  }
  return done;
}

Result<std::optional<Evidence::Line>> Evidence::line() {
  std::size_t looked = 0;
  for (std::size_t wanted = 1;; wanted = kept() + 1) {
    if (const auto filled = fill(wanted); !filled) return filled.error();
    const Byte* const begin = buffer_.data() + begin_;
    const auto* const end =
        kept() == looked ? nullptr
                         : static_cast<const Byte*>(std::memchr(begin + looked, '\n', kept() - looked));
    const bool over = kept() < wanted;
    if (end == nullptr && over && kept() == 0) return std::optional<Line>{};
    if (end == nullptr && kept() > kLongestLine)
      return error_at(offset_, "a line of more than 16 MiB; this is no text");
    looked = kept();
    if (end == nullptr && !over) continue;
    const std::size_t size = end != nullptr ? static_cast<std::size_t>(end - begin) : kept();
    std::string_view text(reinterpret_cast<const char*>(begin), size);
    if (text.ends_with('\r')) text.remove_suffix(1);
    const Line line{text, ++lines_, offset_, end != nullptr};
    take(size + (end != nullptr ? 1 : 0));
    return std::optional(line);
  }
}

Error Evidence::error_at(const Line& line, std::size_t column, std::string_view what) const {
  return make_error(Errc::damaged_tape, fmt::format("{}:{}:{}: {}", name_, line.number, column + 1, what));
}

Error Evidence::error_at(std::uint64_t offset, std::string_view what) const {
  return make_error(Errc::damaged_tape, fmt::format("{} at byte {}: {}", name_, offset, what));
}

}  // namespace porttape
