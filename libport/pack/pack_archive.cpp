#include "libport/pack/pack_archive.hpp"

#include <algorithm>
#include <cerrno>
#include <locale.h>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "libport/archive/lib_archive.hpp"
#include "libport/base/printable.hpp"
#include "libport/tape/payload_totals.hpp"

namespace porttape {
namespace {

constexpr std::size_t kChunk = std::size_t{64} * 1024;
constexpr std::size_t kLongestManifest = std::size_t{4} << 20;
// Of the archive beside its files: a header each, and what fills it up.
constexpr std::uint64_t kHeaderBytes = 16384;
constexpr std::uint64_t kPadding = std::uint64_t{1} << 20;

struct ArchiveReadEnd {
  void operator()(archive* reader) const { libarchive().archive_read_free(reader); }
};
struct ArchiveWriteEnd {
  void operator()(archive* writer) const { libarchive().archive_write_free(writer); }
};
struct EntryEnd {
  void operator()(archive_entry* entry) const { libarchive().archive_entry_free(entry); }
};
// libarchive turns names from and to the locale's letters; while this object is there that is UTF-8.
class Utf8Names {
 public:
  Utf8Names() : mine_(::newlocale(LC_CTYPE_MASK, "C.UTF-8", locale_t{})) {
    if (mine_ != locale_t{}) before_ = ::uselocale(mine_);
  }
  Utf8Names(const Utf8Names&) = delete;
  Utf8Names& operator=(const Utf8Names&) = delete;
  ~Utf8Names() {
    if (mine_ == locale_t{}) return;
    ::uselocale(before_);
    ::freelocale(mine_);
  }

 private:
  locale_t mine_;
  locale_t before_{};
};

using ArchiveReader = std::unique_ptr<archive, ArchiveReadEnd>;
using ArchiveWriter = std::unique_ptr<archive, ArchiveWriteEnd>;

std::string trouble_of(archive* from) {
  const char* text = libarchive().archive_error_string(from);
  return text == nullptr ? "it cannot be read" : text;
}

// Decompresses a source, and holds what comes out against a budget.
class Unpressed {
 public:
  Unpressed(ByteSource& source, std::uint64_t budget)
      : source_(source),
        buffer_(kChunk),
        out_(kChunk),
        reader_(libarchive().archive_read_new()),
        budget_(budget) {}

  Result<void> open() {
    archive* const reader = reader_.get();
    // Others would be programs that are run, or not be those that packs are made with.
    const bool ready = reader != nullptr &&
                       libarchive().archive_read_support_filter_gzip(reader) == ARCHIVE_OK &&
                       libarchive().archive_read_support_filter_zstd(reader) == ARCHIVE_OK &&
                       libarchive().archive_read_support_format_raw(reader) == ARCHIVE_OK;
    if (!ready) return make_error(Errc::io, "this libarchive has no gzip or no zstd");
    archive_entry* entry = nullptr;
    const bool begun =
        libarchive().archive_read_open(reader, this, nullptr, &Unpressed::more, nullptr) == ARCHIVE_OK &&
        libarchive().archive_read_next_header(reader, &entry) == ARCHIVE_OK;
    if (failure_) return *failure_;
    // One, and the source itself.
    if (libarchive().archive_filter_count(reader) != 2)
      return make_error(Errc::not_a_tape, "it is no pack: it is not compressed, or more than once");
    return begun ? Result<void>() : make_error(Errc::io, trouble_of(reader));
  }

  void allow(std::uint64_t more) {
    if (__builtin_add_overflow(budget_, more, &budget_)) budget_ = UINT64_MAX;
  }
  [[nodiscard]] const std::optional<Error>& failure() const { return failure_; }
  // Behind the last byte that is not 0.
  [[nodiscard]] std::uint64_t written_end() const { return written_end_; }

  // The next bytes; none at the end. On an error failure() is there.
  ByteView next() {
    if (failure_) return {};
    const la_ssize_t size = libarchive().archive_read_data(reader_.get(), out_.data(), out_.size());
    if (size < 0 && !failure_) failure_ = make_error(Errc::io, trouble_of(reader_.get()));
    if (size <= 0) return {};
    const ByteView bytes(out_.data(), static_cast<std::size_t>(size));
    const auto last = std::find_if(bytes.rbegin(), bytes.rend(), [](Byte byte) { return byte != 0; });
    if (last != bytes.rend()) written_end_ = total_ + static_cast<std::uint64_t>(bytes.rend() - last);
    total_ += bytes.size();
    if (total_ <= budget_) return bytes;
    failure_ = make_error(Errc::io, "it has more bytes than it tells of");
    return {};
  }

  // Reads on to the end, where the source must end, too.
  Result<void> drain() {
    while (!next().empty()) {
    }
    if (failure_) return *failure_;
    const Result<std::uint64_t> size = source_.size();
    if (!size) return size.error();
    const auto used = static_cast<std::uint64_t>(libarchive().archive_filter_bytes(reader_.get(), -1));
    if (used < *size)
      return make_error(Errc::io, "something follows its end, at offset " + std::to_string(used));
    return {};
  }

 private:
  static la_ssize_t more(archive* reader, void* context, const void** data) {
    auto& self = *static_cast<Unpressed*>(context);
    const Result<std::size_t> read = self.source_.read_at(self.offset_, self.buffer_);
    if (!read) {
      self.failure_ = read.error();
      libarchive().archive_set_error(reader, EIO, "%s", read.error().message.c_str());
      return -1;
    }
    self.offset_ += *read;
    *data = self.buffer_.data();
    return static_cast<la_ssize_t>(*read);
  }

  ByteSource& source_;
  Bytes buffer_;
  Bytes out_;
  std::uint64_t offset_ = 0;
  ArchiveReader reader_;
  std::uint64_t budget_;
  std::uint64_t total_ = 0;
  std::uint64_t written_end_ = 0;
  std::optional<Error> failure_;
};

class PackReader {
 public:
  PackReader(ByteSource& source, PackSink& sink, const PackLimits& limits)
      : source_(source),
        bytes_(source, kLongestManifest + kHeaderBytes + kPadding),
        sink_(sink),
        limits_(limits),
        tar_(libarchive().archive_read_new()),
        chunk_(kChunk) {}

  Result<PackManifest> read() {
    if (Result<void> opened = bytes_.open(); !opened) return opened.error();
    archive* const tar = tar_.get();
    const bool opened =
        tar != nullptr && libarchive().archive_read_support_format_tar(tar) == ARCHIVE_OK &&
        libarchive().archive_read_open(tar, this, nullptr, &PackReader::more, nullptr) == ARCHIVE_OK;
    if (!opened)
      return bytes_.failure() ? *bytes_.failure()
                              : make_error(Errc::not_a_tape, "it is no pack: no tar is in it");
    if (Result<void> read = first(); !read) return read.error();
    for (;;) {
      const Result<archive_entry*> entry = next();
      if (!entry) return entry.error();
      if (*entry == nullptr) break;
      if (Result<void> taken = file(*entry); !taken) return taken.error();
    }
    if (Result<void> whole = end(); !whole) return whole.error();
    return std::move(manifest_);
  }

 private:
  static la_ssize_t more(archive* tar, void* context, const void** data) {
    auto& self = *static_cast<PackReader*>(context);
    const ByteView bytes = self.bytes_.next();
    if (self.bytes_.failure()) {
      libarchive().archive_set_error(tar, EIO, "%s", self.bytes_.failure()->message.c_str());
      return -1;
    }
    *data = bytes.data();
    return static_cast<la_ssize_t>(bytes.size());
  }

  [[nodiscard]] Error failed() const {
    return bytes_.failure() ? *bytes_.failure() : make_error(Errc::io, trouble_of(tar_.get()));
  }

  // Null at the archive's end.
  Result<archive_entry*> next() {
    archive_entry* entry = nullptr;
    const int status = libarchive().archive_read_next_header(tar_.get(), &entry);
    if (status == ARCHIVE_EOF && !bytes_.failure()) return static_cast<archive_entry*>(nullptr);
    if (status != ARCHIVE_OK || bytes_.failure()) return failed();
    return entry;
  }

  // The name without the folder, of an entry that is one of a pack.
  Result<std::string> plain(archive_entry* entry) {
    const char* const told = libarchive().archive_entry_pathname_utf8(entry);
    if (told == nullptr) return make_error(Errc::io, "it has a file whose name is no UTF-8");
    const std::string path = told;
    const auto refused = [&](const char* why) {
      return make_error(Errc::io, "it holds " + in_quotes(path) + ", " + why + "; nothing was unpacked");
    };
    if (libarchive().archive_entry_hardlink(entry) != nullptr) return refused("a hard link");
    if (libarchive().archive_entry_symlink(entry) != nullptr ||
        libarchive().archive_entry_filetype(entry) == AE_IFLNK)
      return refused("a symbolic link");
    if (libarchive().archive_entry_filetype(entry) != AE_IFREG) return refused("which is no plain file");
    if (libarchive().archive_entry_sparse_count(entry) > 0) return refused("a file with holes");
    const std::size_t slash = path.find('/');
    if (slash == std::string::npos) return refused("which is in no folder");
    const std::string folder = path.substr(0, slash);
    std::string name = path.substr(slash + 1);
    if (!is_plain_name(folder) || !is_plain_name(name))
      return refused("which is no name of a file in one folder");
    if (!folder_) folder_ = folder;
    if (folder != *folder_) return refused("in another folder than the first");
    if (!seen_.insert(name).second) return refused("twice");
    if (libarchive().archive_entry_size_is_set(entry) == 0 || libarchive().archive_entry_size(entry) < 0)
      return refused("of no size");
    return name;
  }

  Result<void> first() {
    const Result<archive_entry*> entry = next();
    if (!entry) return entry.error();
    if (*entry == nullptr) return make_error(Errc::not_a_tape, "it is no pack: it is empty");
    const Result<std::string> name = plain(*entry);
    if (!name) return name.error();
    const auto size = static_cast<std::uint64_t>(libarchive().archive_entry_size(*entry));
    if (*name != kManifestName)
      return make_error(Errc::not_a_tape, "it is no pack: its first file is no manifest.json");
    if (size > kLongestManifest) return make_error(Errc::io, "its manifest.json has more than 4 MiB");
    std::string text;
    Result<std::uint64_t> read = content(size, [&](ByteView bytes) -> Result<void> {
      text += as_text(bytes);
      return {};
    });
    if (!read) return read.error();
    Result<PackManifest> manifest = read_manifest(text);
    if (!manifest) return manifest.error();
    manifest_ = std::move(*manifest);
    if (Result<void> allowed = check_limits(); !allowed) return allowed;
    bytes_.allow(manifest_.bytes());
    bytes_.allow(manifest_.files.size() * kHeaderBytes);
    return to_sink(std::string(kManifestName), size, [&] { return sink_.write(as_bytes(text)); });
  }

  Result<std::uint64_t> most_bytes() {
    if (limits_.bytes) return *limits_.bytes;
    const Result<std::uint64_t> size = source_.size();
    if (!size) return size.error();
    return std::max(*size * PackLimits::kUsualFactor, PackLimits::kUsualBytes);
  }

  Result<void> check_limits() {
    if (manifest_.files.size() > limits_.files)
      return make_error(Errc::usage, "it has " + std::to_string(manifest_.files.size()) +
                                         " files, more than the " + std::to_string(limits_.files) +
                                         " that are allowed");
    const Result<std::uint64_t> most = most_bytes();
    if (!most) return most.error();
    if (manifest_.bytes() > *most)
      return make_error(Errc::usage,
                        "it unpacks to " + std::to_string(manifest_.bytes()) + " bytes; --max-size " +
                            std::to_string(manifest_.bytes() / 1'000'000 + 1) + " (megabytes) allows it");
    return {};
  }

  template <class Write>
  Result<void> to_sink(const std::string& name, std::uint64_t size, const Write& write) {
    if (Result<void> begun = sink_.begin_file(name, size); !begun) return begun;
    if (Result<void> written = write(); !written) return written;
    return sink_.end_file();
  }

  Result<void> file(archive_entry* entry) {
    const Result<std::string> name = plain(entry);
    if (!name) return name.error();
    const PackedFile* told = manifest_.file(*name);
    if (told == nullptr)
      return make_error(Errc::io, "it holds " + in_quotes(*name) + ", of which manifest.json does not tell");
    const auto size = static_cast<std::uint64_t>(libarchive().archive_entry_size(entry));
    if (size != told->size)
      return make_error(Errc::io, "its file " + in_quotes(*name) + " has " + std::to_string(size) +
                                      " bytes, and " + std::to_string(told->size) + " in manifest.json");
    return to_sink(*name, size, [&]() -> Result<void> {
      const Result<std::uint64_t> digest =
          content(size, [this](ByteView bytes) { return sink_.write(bytes); });
      if (!digest) return digest.error();
      if (*digest == told->xxh3) return {};
      return make_error(Errc::io,
                        "its file " + in_quotes(*name) + " is not what was packed: its digest is another");
    });
  }

  // So many bytes of the entry, and no more; their digest.
  template <class Take>
  Result<std::uint64_t> content(std::uint64_t size, const Take& take) {
    PayloadCounter digest;
    std::uint64_t left = size;
    for (;;) {
      const la_ssize_t got = libarchive().archive_read_data(tar_.get(), chunk_.data(), chunk_.size());
      if (got < 0 || bytes_.failure()) return failed();
      if (got == 0) break;
      const ByteView bytes(chunk_.data(), static_cast<std::size_t>(got));
      if (bytes.size() > left) return make_error(Errc::io, "a file is longer than it tells");
      left -= bytes.size();
      digest.add(bytes);
      if (Result<void> taken = take(bytes); !taken) return taken.error();
    }
    if (left > 0) return make_error(Errc::io, "it is cut off");
    return *digest.totals().xxh3;
  }

  Result<void> end() {
    for (const PackedFile& file : manifest_.files) {
      if (seen_.count(file.name) == 0)
        return make_error(Errc::io, "it lacks " + in_quotes(file.name) + ", of which manifest.json tells");
    }
    const auto used = static_cast<std::uint64_t>(libarchive().archive_filter_bytes(tar_.get(), -1));
    if (Result<void> drained = bytes_.drain(); !drained) return drained;
    if (bytes_.written_end() > used) return make_error(Errc::io, "something follows the archive's end");
    return {};
  }

  ByteSource& source_;
  Unpressed bytes_;
  PackSink& sink_;
  const PackLimits& limits_;
  ArchiveReader tar_;
  Bytes chunk_;
  std::optional<std::string> folder_;
  std::set<std::string> seen_;
  PackManifest manifest_;
};

}  // namespace

struct PackWriter::Impl {
  Put put;
  std::string folder;
  std::optional<Error> failure;  // of put
  ArchiveWriter writer{libarchive().archive_write_new()};

  [[nodiscard]] Error failed() const {
    return failure ? *failure : make_error(Errc::io, trouble_of(writer.get()));
  }
  static la_ssize_t give(archive* writer, void* context, const void* data, std::size_t size) {
    auto& self = *static_cast<Impl*>(context);
    const Result<void> done = self.put(ByteView(static_cast<const Byte*>(data), size));
    if (done) return static_cast<la_ssize_t>(size);
    if (!self.failure) self.failure = done.error();
    libarchive().archive_set_error(writer, EIO, "%s", done.error().message.c_str());
    return -1;
  }
};

PackWriter::PackWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PackWriter::PackWriter(PackWriter&&) noexcept = default;
PackWriter& PackWriter::operator=(PackWriter&&) noexcept = default;
PackWriter::~PackWriter() = default;

Result<PackWriter> PackWriter::begin(Put put, PackFormat format, const std::string& folder) {
  if (const auto& loaded = load_libarchive(); !loaded) return loaded.error();
  auto impl = std::make_unique<Impl>();
  impl->put = std::move(put);
  impl->folder = folder;
  archive* const writer = impl->writer.get();
  if (writer == nullptr) return make_error(Errc::io, errno_text(ENOMEM));
  const int filter = format == PackFormat::gzip ? libarchive().archive_write_add_filter_gzip(writer)
                                                : libarchive().archive_write_add_filter_zstd(writer);
  if (filter != ARCHIVE_OK || libarchive().archive_write_set_format_pax_restricted(writer) != ARCHIVE_OK ||
      libarchive().archive_write_set_bytes_in_last_block(writer, 1) != ARCHIVE_OK ||  // nothing is filled up
      libarchive().archive_write_open(writer, impl.get(), nullptr, &Impl::give, nullptr) != ARCHIVE_OK)
    return impl->failed();
  return PackWriter(std::move(impl));
}

Result<void> PackWriter::begin_file(const std::string& name, std::uint64_t size) {
  const Utf8Names names;
  const std::unique_ptr<archive_entry, EntryEnd> entry(libarchive().archive_entry_new());
  if (!entry) return make_error(Errc::io, errno_text(ENOMEM));
  libarchive().archive_entry_set_pathname_utf8(entry.get(), (impl_->folder + "/" + name).c_str());
  if (libarchive().archive_entry_pathname(entry.get()) == nullptr)
    return make_error(Errc::usage,
                      "the name " + in_quotes(name) + " cannot be packed here: there is no locale C.UTF-8");
  libarchive().archive_entry_set_filetype(entry.get(), AE_IFREG);
  libarchive().archive_entry_set_perm(entry.get(), 0640);
  libarchive().archive_entry_set_size(entry.get(), static_cast<la_int64_t>(size));
  const int status = libarchive().archive_write_header(impl_->writer.get(), entry.get());
  return status == ARCHIVE_OK ? Result<void>() : impl_->failed();
}

Result<void> PackWriter::write(ByteView bytes) {
  const la_ssize_t done = libarchive().archive_write_data(impl_->writer.get(), bytes.data(), bytes.size());
  return done == static_cast<la_ssize_t>(bytes.size()) ? Result<void>() : impl_->failed();
}

Result<void> PackWriter::finish() {
  const Utf8Names names;
  return libarchive().archive_write_close(impl_->writer.get()) == ARCHIVE_OK ? Result<void>()
                                                                             : impl_->failed();
}

Result<PackManifest> read_pack(ByteSource& source, PackSink& sink, const PackLimits& limits) {
  if (const auto& loaded = load_libarchive(); !loaded) return loaded.error();
  const Utf8Names names;
  return PackReader(source, sink, limits).read();
}

}  // namespace porttape
