// Any bytes as a pack, a bare tar compressed and with right checksums in its headers: no crash; the sink gets
// plain names once, and no more bytes than were told; what is accepted is what the manifest tells of.

#include <algorithm>
#include <cstdio>
#include <string_view>
#include <zlib.h>

#include "libport/pack/pack_archive.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/support/memory_pack.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

constexpr std::size_t kTarBlock = 512;

bool is_tar_header(ByteView block) { return as_text(block.subspan(257)).starts_with("ustar"); }

void mend_checksum(std::span<Byte> header) {
  constexpr std::size_t place = 148;
  constexpr std::size_t size = 8;
  std::fill_n(header.begin() + place, size, Byte{' '});
  unsigned sum = 0;
  for (const Byte byte : header) sum += byte;
  char text[size] = {};
  std::snprintf(text, sizeof text, "%06o", sum);
  std::copy_n(text, size, header.begin() + place);
}

Bytes compressed(Bytes tar) {
  for (std::size_t at = 0; at + kTarBlock <= tar.size(); at += kTarBlock) {
    const std::span<Byte> block = std::span(tar).subspan(at, kTarBlock);
    if (is_tar_header(block)) mend_checksum(block);
  }
  constexpr int gzip_of_32k = 31;
  constexpr int memory = 8;
  z_stream stream{};
  require(
      deflateInit2(&stream, Z_NO_COMPRESSION, Z_DEFLATED, gzip_of_32k, memory, Z_DEFAULT_STRATEGY) == Z_OK,
      "zlib begins");
  Bytes out(deflateBound(&stream, tar.size()));
  stream.next_in = tar.data();
  stream.avail_in = static_cast<uInt>(tar.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  require(deflate(&stream, Z_FINISH) == Z_STREAM_END, "zlib compresses");
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, data + size);
  if (size >= kTarBlock && is_tar_header(bytes)) bytes = compressed(std::move(bytes));
  MemorySource source("pack", std::move(bytes));
  MemoryPackSink sink;
  const PackLimits limits{.bytes = 1 << 20, .files = 16};
  const Result<PackManifest> pack = read_pack(source, sink, limits);
  require(!sink.twice && !sink.odd, "names are plain, and come once");
  require(sink.given <= sink.told && sink.told <= *limits.bytes + (4 << 20), "no more bytes than are told");
  if (!pack) {
    require(!pack.error().message.empty(), "it is told what is wrong");
    return 0;
  }
  require(sink.files.size() == pack->files.size() + 1, "all files are there");
  for (const PackedFile& file : pack->files)
    require(sink.files[file.name].size() == file.size, "as long as told");
  const Result<PackManifest> again = read_manifest(to_json(*pack));
  require(again && *again == *pack, "a manifest is understood as it was written down");
  return 0;
}
