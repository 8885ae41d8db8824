#include "libport/tape/byte_source.hpp"

#include <array>
#include <cstdint>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/source_window.hpp"
#include "libport/tape/stored_bytes.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/holed_source.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::TempDir;
using testing::HasSubstr;

std::string text_at(ByteSource& source, std::uint64_t offset, std::size_t most) {
  Bytes into(most, Byte{'.'});
  const auto got = source.read_at(offset, into);
  if (!got) return "error: " + got.error().message;
  return std::string(as_text(ByteView(into).first(*got)));
}

void expect_holds_abcdef(ByteSource& source) {
  EXPECT_EQ(text_at(source, 0, 6), "abcdef");
  EXPECT_EQ(text_at(source, 0, 100), "abcdef");
  EXPECT_EQ(text_at(source, 2, 3), "cde");
  EXPECT_EQ(text_at(source, 5, 3), "f");
  EXPECT_EQ(text_at(source, 6, 3), "");
  EXPECT_EQ(text_at(source, 7, 3), "");
  EXPECT_EQ(text_at(source, 3, 0), "");
  EXPECT_EQ(*source.size(), 6U);
}

TEST(MemorySource, GivesTheBytesFromAnOffsetOn) {
  MemorySource source("m", test::bytes_of("abcdef"));
  expect_holds_abcdef(source);
  EXPECT_EQ(source.name(), "m");
}

TEST(FileSource, InAFolderIsNotWhatALinkThereLeadsTo) {
  const TempDir dir;
  test::write_file(dir / "f", test::bytes_of("abcdef"));
  std::filesystem::create_symlink("f", dir / "link");
  const UniqueFd folder(::open(dir.path().c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  const auto source = FileSource::open_in(folder.get(), "f", "shown");
  ASSERT_TRUE(source);
  expect_holds_abcdef(**source);
  EXPECT_EQ((**source).name(), "shown");
  EXPECT_THAT(FileSource::open_in(folder.get(), "link", "shown").error().message,
              HasSubstr("shown is a link"));
  EXPECT_THAT(FileSource::open_in(folder.get(), "none", "shown").error().message,
              HasSubstr("cannot read shown: No such file"));
}

TEST(FileSource, ADuplicateIsTheSameFileWhateverItsNameMeans) {
  const TempDir dir;
  test::write_file(dir / "f", test::bytes_of("abcdef"));
  const auto source = FileSource::open(dir / "f");
  ASSERT_TRUE(source);
  test::write_file(dir / "other", test::bytes_of("other"));
  std::filesystem::rename(dir / "other", dir / "f");
  const auto same = (**source).duplicate();
  ASSERT_TRUE(same);
  EXPECT_NE((**same).fd(), (**source).fd());
  expect_holds_abcdef(**same);
  EXPECT_EQ((**same).name(), dir / "f");
}

TEST(FileSource, GivesTheBytesFromAnOffsetOn) {
  const TempDir dir;
  test::write_file(dir / "f", test::bytes_of("abcdef"));
  const auto source = FileSource::open(dir / "f");
  ASSERT_TRUE(source);
  expect_holds_abcdef(**source);
  EXPECT_EQ((**source).name(), dir / "f");
  test::write_file(dir / "f", test::bytes_of("abcdefgh"));
  EXPECT_EQ(*(**source).size(), 8U);
}

TEST(FileSource, AnOffsetThatNoFileHasIsToldWithTheName) {
  const TempDir dir;
  test::write_file(dir / "f", test::bytes_of("abcdef"));
  const auto source = FileSource::open(dir / "f");
  ASSERT_TRUE(source);
  Bytes into(1);
  const auto got = (**source).read_at(std::numeric_limits<std::uint64_t>::max(), into);
  ASSERT_FALSE(got);
  EXPECT_EQ(got.error(), make_error(Errc::io, "cannot read " + (dir / "f") +
                                                  " at offset 18446744073709551615: Invalid argument"));
}

TEST(FileSource, WhatIsNotThereIsNamed) {
  const TempDir dir;
  EXPECT_EQ(FileSource::open(dir / "f").error(),
            make_error(Errc::usage, "cannot read " + (dir / "f") + ": No such file or directory"));
}

TEST(FileSource, WhatIsNoRegularFileIsNamedByItsKind) {
  const TempDir dir;
  std::filesystem::create_directory(dir / "folder");
  ASSERT_EQ(::mkfifo((dir / "fifo").c_str(), 0600), 0);
  const int listener = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string path = dir / "socket";
  ASSERT_LT(path.size(), sizeof address.sun_path);
  path.copy(address.sun_path, path.size());
  ASSERT_EQ(::bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ::close(listener);
  for (const auto& [name, kind] : {std::pair("folder", "a folder"), std::pair("fifo", "a FIFO"),
                                   std::pair("socket", "a socket"), std::pair("/dev/null", "a device")}) {
    const std::string file = name[0] == '/' ? name : dir / name;
    EXPECT_EQ(FileSource::open(file).error(),
              make_error(Errc::usage, file + " is " + kind + "; a tape is made of regular files"));
  }
}

TEST(FileSource, WithoutADescriptorToBeHadTheFileIsNotToBlame) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  const TempDir dir;
  test::write_file(dir / "f", test::bytes_of("abcdef"));
  const auto source = [&] {
    const test::NoDescriptors none(unsanitized);
    return FileSource::open(dir / "f");
  }();
  EXPECT_EQ(source.error(), make_error(Errc::io, "cannot read " + (dir / "f") + ": Too many open files"));
}

TEST(FileSource, TellsWhereItsBytesAre) {
  const test::TempDir dir;
  std::ofstream(dir / "f") << std::string(100'000, 'x');
  std::filesystem::resize_file(dir / "f", 100'000'000);
  const auto source = FileSource::open(dir / "f");
  ASSERT_TRUE(source);
  FileSource& file = **source;
  if (file.stored(50'000'000).begin == 50'000'000) GTEST_SKIP() << "this file system tells of no holes";
  EXPECT_EQ(file.stored(7).begin, 7U);
  EXPECT_GE(file.stored(7).end, 100'000U);
  EXPECT_LT(file.stored(7).end, 50'000'000U);
  EXPECT_EQ(file.stored(50'000'000).begin, 100'000'000U);
  EXPECT_EQ(file.stored(50'000'000).end, 100'000'000U);
  EXPECT_GE(StoredBytes(file).count(100'000'000), 100'000U);
  EXPECT_LT(StoredBytes(file).count(100'000'000), 50'000'000U);
}

TEST(StoredBytes, OnlyALongHoleCounts) {
  constexpr std::uint64_t kLong = StoredBytes::kLongHole;
  test::HoledSource::Read read;
  test::HoledSource source(read, 10 * kLong,
                           {{0, Bytes(10)}, {kLong + 10, Bytes(10)}, {5 * kLong, Bytes(10)}});
  StoredBytes stored(source);
  EXPECT_EQ(stored.behind_hole(5), 5U);
  EXPECT_EQ(stored.behind_hole(10), 10U) << "as long as may be";
  EXPECT_EQ(stored.behind_hole(kLong + 20), 5 * kLong);
  EXPECT_EQ(stored.behind_hole(4 * kLong), 4 * kLong) << "what is left of it is short";
  EXPECT_EQ(stored.behind_hole(5 * kLong + 10), 10 * kLong);
  EXPECT_FALSE(stored.has_hole(0, kLong + 20));
  EXPECT_TRUE(stored.has_hole(0, 5 * kLong));
  EXPECT_FALSE(stored.has_hole(kLong + 20, 2 * kLong)) << "it is shorter than a long hole";
  EXPECT_GT(stored.calls(), 0);
  EXPECT_EQ(stored.count(10 * kLong), kLong + 20 + 10) << "with the short hole";
  EXPECT_EQ(stored.count(5), 5U);
}

// Counts what is read of it.
class CountedSource final : public ByteSource {
 public:
  explicit CountedSource(Bytes bytes) : bytes_("c", std::move(bytes)) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    ++reads;
    if (fails) return make_error(Errc::io, "out of order");
    return bytes_.read_at(offset, into);
  }
  Result<std::uint64_t> size() override { return bytes_.size(); }
  [[nodiscard]] const std::string& name() const override { return bytes_.name(); }

  int reads = 0;
  bool fails = false;

 private:
  MemorySource bytes_;
};

TEST(SourceWindow, ReadsOnceWhatIsLookedAtTwice) {
  Bytes bytes(SourceWindow::kSize + 10);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<Byte>(i * 7);
  CountedSource source(bytes);
  SourceWindow window(source);
  const auto look = [&](std::uint64_t offset, std::size_t most, std::size_t wanted) {
    const auto view = window.view(offset, most);
    ASSERT_TRUE(view);
    ASSERT_EQ(view->size(), wanted);
    for (std::size_t i = 0; i < wanted; ++i) ASSERT_EQ((*view)[i], bytes[offset + i]);
  };
  look(5, 10, 10);
  EXPECT_EQ(source.reads, 1);
  look(5, SourceWindow::kSize, SourceWindow::kSize);
  look(SourceWindow::kSize - 5, 10, 10);
  EXPECT_EQ(source.reads, 1);
  look(SourceWindow::kSize - 4, 10, 10);  // one byte more than the window has
  EXPECT_EQ(source.reads, 2);
  look(4, 1, 1);
  EXPECT_EQ(source.reads, 3);
  look(0, SourceWindow::kSize + 1, SourceWindow::kSize);
  look(bytes.size() - 3, 10, 3);
  look(bytes.size(), 10, 0);
  source.fails = true;
  EXPECT_EQ(window.view(0, 1).error().message, "out of order");
}

}  // namespace
}  // namespace porttape
