#include "libport/pack/pack_manifest.hpp"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::HasSubstr;

PackManifest sample() {
  return {.created = "2024-05-06T07:08:09Z",
          .tool = "porttape 1",
          .tapes = {{"a.log", "12ab", "sound", {"a.logr", "a.loge"}}},
          .files = {{"a.logr", 5, 0x0123456789abcdef}, {"a.loge", 0, 1}, {"redaction.json", 7, 2}},
          .driver_version = "d \"1\"",
          .driver_command = "d -x",
          .redaction = true,
          .system = {{"kernel", "Linux"}}};
}

std::string refused(const PackManifest& manifest) {
  const auto read = read_manifest(to_json(manifest));
  return read ? "" : read.error().message;
}

TEST(PackManifestTest, IsReadAsItWasWritten) {
  const auto read = read_manifest(to_json(sample()));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(*read, sample());
}

TEST(PackManifestTest, PlainNames) {
  for (const char* const name : {"a", "laser.logr", "\xc3\xa4.logr", "a.-b", " ", "\xe2\x82\xac"})
    EXPECT_TRUE(is_plain_name(name)) << name;
  for (const char* const name :
       {"", ".", "..", "a/b", "/a", "a\\b", "a\nb", "\x7f", "\xff", "a/", "...", ".a", "-x",
        "a\xc2\x9b"
        "31m",
        "a\xe2\x80\xae"
        "b",
        "a\xe2\x80\xa8", "\xd8\x9c"})
    EXPECT_FALSE(is_plain_name(name)) << name;
  EXPECT_FALSE(is_plain_name(std::string("a\0b", 3)));
  EXPECT_FALSE(is_plain_name(std::string(256, 'a')));
}

TEST(PackManifestTest, AFileOfNoTapeIsRefused) {
  PackManifest pack = sample();
  pack.files.push_back({"b.logr", 1, 3});
  EXPECT_THAT(refused(pack), HasSubstr("a file 'b.logr', which belongs to none of its tapes"));
  pack.files.back().name = "Makefile";
  EXPECT_THAT(refused(pack), HasSubstr("a file 'Makefile', which belongs to none of its tapes"));
  pack.files.back().name =
      "a\xc2\x9b"
      "2J";
  EXPECT_THAT(refused(pack), HasSubstr("a file 'a\\x9b2J', which is no plain name"));
  pack.files.pop_back();
  pack.redaction = false;
  EXPECT_THAT(refused(pack), HasSubstr("a file 'redaction.json', which belongs to none"));
}

TEST(PackManifestTest, WhatCannotBeIsTold) {
  PackManifest pack = sample();
  pack.files[0].name = "../a.logr";
  EXPECT_THAT(refused(pack), HasSubstr("no plain name"));
  pack = sample();
  pack.files[2].name = "a.logr";
  EXPECT_THAT(refused(pack), HasSubstr("'a.logr' twice"));
  pack.files[2].name = "manifest.json";
  EXPECT_THAT(refused(pack), HasSubstr("'manifest.json' twice"));
  pack = sample();
  pack.tapes[0].name = "..";
  EXPECT_THAT(refused(pack), HasSubstr("a tape '..'"));
  pack.tapes[0].name = "b.log";
  EXPECT_THAT(refused(pack), HasSubstr("no file of the tape 'b.log'"));
  pack = sample();
  pack.tapes.push_back(pack.tapes[0]);
  EXPECT_THAT(refused(pack), HasSubstr("the tape 'a.log' twice"));
  pack.tapes.clear();
  EXPECT_THAT(refused(pack), HasSubstr("no tape"));
  pack = sample();
  pack.files.pop_back();
  EXPECT_THAT(refused(pack), HasSubstr("no redaction.json"));
  pack.files.clear();
  EXPECT_THAT(refused(pack), HasSubstr("no files"));
  pack = sample();
  pack.files[0].size = UINT64_MAX;
  EXPECT_THAT(refused(pack), HasSubstr("impossibly many bytes"));
  for (const char* const text :
       {"", "[]", "{}", R"({"format":"porttape-pack"})", R"({"format":"porttape-pack","version":2})",
        R"({"format":"porttape-pack","version":1,"files":[{"name":"a","size":-1,"xxh3":"0"}]})"})
    EXPECT_FALSE(read_manifest(text)) << text;
}

}  // namespace
}  // namespace porttape
