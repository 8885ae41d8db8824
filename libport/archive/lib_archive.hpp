#pragma once

#include <archive.h>
#include <archive_entry.h>

#include "libport/base/result.hpp"

namespace porttape {

// The functions of libarchive that are used here, one line each.
#define PORTTAPE_LIBARCHIVE_CALLS(call)                                                                      \
  call(archive_entry_filetype) call(archive_entry_free) call(archive_entry_hardlink) call(archive_entry_new) \
      call(archive_entry_pathname) call(archive_entry_pathname_utf8) call(archive_entry_set_filetype) call(  \
          archive_entry_set_mtime) call(archive_entry_set_pathname) call(archive_entry_set_pathname_utf8)    \
          call(archive_entry_set_perm) call(archive_entry_set_size) call(archive_entry_size)                 \
              call(archive_entry_size_is_set) call(archive_entry_sparse_count) call(archive_entry_symlink)   \
                  call(archive_error_string) call(archive_filter_bytes) call(archive_filter_count)           \
                      call(archive_read_data) call(archive_read_free) call(archive_read_new)                 \
                          call(archive_read_next_header) call(archive_read_open) call(                       \
                              archive_read_support_filter_gzip) call(archive_read_support_filter_zstd)       \
                              call(archive_read_support_format_raw) call(archive_read_support_format_tar)    \
                                  call(archive_read_support_format_zip_streamable) call(archive_set_error)   \
                                      call(archive_write_add_filter_gzip)                                    \
                                          call(archive_write_add_filter_zstd) call(archive_write_close)      \
                                              call(archive_write_data) call(archive_write_fail)              \
                                                  call(archive_write_free) call(archive_write_header)        \
                                                      call(archive_write_new) call(archive_write_open)       \
                                                          call(archive_write_set_bytes_in_last_block)        \
                                                              call(archive_write_set_bytes_per_block) call(  \
                                                                  archive_write_set_format_pax_restricted)   \
                                                                  call(archive_write_set_format_zip)         \
                                                                      call(archive_write_set_options)

// libarchive, which is loaded when it is first needed: it brings eight libraries, which a program that reads
// and writes no archive should not wait for at its start.
struct LibArchive {
#define PORTTAPE_MEMBER(name) decltype(&::name) name = nullptr;
  PORTTAPE_LIBARCHIVE_CALLS(PORTTAPE_MEMBER)
#undef PORTTAPE_MEMBER
};

// Loads the library at the first call; it stays for the process' life. Errc::io: it is not there, or is
// another than the one that was built against, with what to install. Any thread may call.
const Result<LibArchive>& load_libarchive();

// The library after load_libarchive() has succeeded. Throws UncheckedError where it has not.
const LibArchive& libarchive();

}  // namespace porttape
