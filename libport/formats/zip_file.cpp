#include "libport/formats/zip_file.hpp"

#include <algorithm>
#include <array>
#include <ctime>
#include <utility>

#include "libport/archive/lib_archive.hpp"

namespace porttape {

struct ZipReader::Impl {
  explicit Impl(Evidence& evidence) : from(evidence) {}

  static la_ssize_t give(struct archive*, void* data, const void** bytes) {
    auto& self = *static_cast<Impl*>(data);
    const auto got = self.from.read(self.buffer);
    if (!got) {
      self.failed = got.error();
      return -1;
    }
    *bytes = self.buffer.data();
    return static_cast<la_ssize_t>(*got);
  }

  Error error() {
    if (failed) return *failed;
    const char* const text = libarchive().archive_error_string(zip.get());
    return from.error_at(from.offset(), std::string("the zip is damaged: ") +
                                            (text == nullptr ? "what follows cannot be read" : text));
  }

  struct Free {
    void operator()(struct archive* each) const { libarchive().archive_read_free(each); }
  };
  Evidence& from;
  std::unique_ptr<struct archive, Free> zip;
  std::array<Byte, std::size_t{16} * 1024> buffer{};
  std::array<Byte, std::size_t{64} * 1024> piece{};
  std::optional<Error> failed;
  bool opened = false;
};

ZipReader::ZipReader(Evidence& from) : impl_(std::make_unique<Impl>(from)) {}
ZipReader::~ZipReader() = default;

Result<std::optional<std::string>> ZipReader::next() {
  if (!std::exchange(impl_->opened, true)) {
    if (const auto& loaded = load_libarchive(); !loaded) return loaded.error();
    impl_->zip.reset(libarchive().archive_read_new());
    struct archive* const zip = impl_->zip.get();
    if (zip == nullptr) return make_error(Errc::io, "no memory to read a zip");
    libarchive().archive_read_support_format_zip_streamable(zip);
    if (libarchive().archive_read_open(zip, impl_.get(), nullptr, Impl::give, nullptr) != ARCHIVE_OK)
      return impl_->error();
  }
  struct archive_entry* entry = nullptr;
  const int status = libarchive().archive_read_next_header(impl_->zip.get(), &entry);
  if (status == ARCHIVE_EOF) return std::optional<std::string>{};
  if (status < ARCHIVE_WARN) return impl_->error();
  const char* const name = libarchive().archive_entry_pathname(entry);
  return std::optional(std::string(name == nullptr ? "" : name));
}

Result<ByteView> ZipReader::read() {
  const la_ssize_t size =
      libarchive().archive_read_data(impl_->zip.get(), impl_->piece.data(), impl_->piece.size());
  if (size < 0) return impl_->error();
  return ByteView(impl_->piece).first(static_cast<std::size_t>(size));
}

struct ZipWriter::Impl {
  explicit Impl(NewFile& file) : to(file) {}

  static la_ssize_t take(struct archive*, void* data, const void* bytes, std::size_t size) {
    auto& self = *static_cast<Impl*>(data);
    if (Result<void> added = self.to.add(ByteView(static_cast<const Byte*>(bytes), size)); !added) {
      self.failed = added.error();
      return -1;
    }
    return static_cast<la_ssize_t>(size);
  }

  Result<void> done(bool well) {
    if (failed) return *failed;
    if (well) return {};
    const char* const text = zip ? libarchive().archive_error_string(zip.get()) : nullptr;
    return make_error(Errc::io, to.name() + " cannot be written: " + (text == nullptr ? "no memory" : text));
  }

  struct Free {
    void operator()(struct archive* each) const { libarchive().archive_write_free(each); }
  };
  NewFile& to;
  std::unique_ptr<struct archive, Free> zip;
  std::optional<Error> failed;
  bool opened = false;
};

ZipWriter::ZipWriter(NewFile& to) : impl_(std::make_unique<Impl>(to)) {}
// What is not finished is no zip: nothing more is written of it.
ZipWriter::~ZipWriter() {
  if (impl_->opened) libarchive().archive_write_fail(impl_->zip.get());
}

Result<void> ZipWriter::add(const std::string& name, ByteView bytes) {
  if (!impl_->opened) {
    if (const auto& loaded = load_libarchive(); !loaded) return loaded.error();
    impl_->zip.reset(libarchive().archive_write_new());
    if (!impl_->zip) return impl_->done(false);
    struct archive* const zip = impl_->zip.get();
    libarchive().archive_write_set_format_zip(zip);
    libarchive().archive_write_set_options(zip, "zip:compression-level=1");
    libarchive().archive_write_set_bytes_per_block(zip, 0);
    if (libarchive().archive_write_open(zip, impl_.get(), nullptr, Impl::take, nullptr) != ARCHIVE_OK)
      return impl_->done(false);
    impl_->opened = true;
  }
  struct archive* const zip = impl_->zip.get();
  struct FreeEntry {
    void operator()(struct archive_entry* entry) const { libarchive().archive_entry_free(entry); }
  };
  const std::unique_ptr<struct archive_entry, FreeEntry> entry(libarchive().archive_entry_new());
  if (!entry) return impl_->done(false);
  constexpr std::time_t kFirstOfZip = 315'532'800;  // 1980: the same tape gives the same file
  libarchive().archive_entry_set_pathname(entry.get(), name.c_str());
  libarchive().archive_entry_set_filetype(entry.get(), AE_IFREG);
  libarchive().archive_entry_set_perm(entry.get(), 0640);
  libarchive().archive_entry_set_mtime(entry.get(), kFirstOfZip, 0);
  libarchive().archive_entry_set_size(entry.get(), static_cast<la_int64_t>(bytes.size()));
  if (libarchive().archive_write_header(zip, entry.get()) < ARCHIVE_WARN) return impl_->done(false);
  const la_ssize_t written = libarchive().archive_write_data(zip, bytes.data(), bytes.size());
  return impl_->done(written == static_cast<la_ssize_t>(bytes.size()));
}

Result<void> ZipWriter::finish() {
  if (!std::exchange(impl_->opened, false)) return {};
  return impl_->done(libarchive().archive_write_close(impl_->zip.get()) == ARCHIVE_OK);
}

}  // namespace porttape
