// Each verb that makes files of tapes. A file that a verb makes is as strict as the files it is made of, and
// no verb writes through another user's link.
#include <array>
#include <filesystem>
#include <fstream>
#include <string>
#include <sys/stat.h>
#include <vector>

#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

namespace fs = std::filesystem;

struct MadeBy {
  std::vector<std::string> command;  // @ is the new file or tape
  std::vector<std::string> files;    // that it makes
  bool replaces = true;              // by --overwrite
};

const std::vector<std::string> kTape{"@.logr", "@.logw", "@.loge"};
const std::string kDriver =
    R"(exec 3<>{port}; echo ask >&3; read answer <&3; echo more >&3; read answer <&3; test "$answer" = 43)";

class SourceModes : public testing::Test {
 protected:
  SourceModes() : umask_(::umask(022)) {
    for (const std::string name : {"t", "u"})
      make_tape(dir, name, {{2000, "42\n"}, {1'200'000, "43\n"}}, {{1000, "ask\n"}, {1'100'000, "more\n"}},
                R"({"t_us":0,"event":"open"})"
                "\n"
                R"({"t_us":1300000,"event":"close"})"
                "\n");
    fs::create_directory(dir / "other");
    make_tape(dir, "other/v", {{2000, "42\n"}}, {{1000, "ask 7\n"}, {1'100'000, "more\n"}});
    fs::create_directory(dir / "out");  // the suite's folder has tapes of its own alone
    std::ofstream(dir / "secret.rules") << "[[redact]]\nname = 'answer'\ntext = '42'\n";
    std::ofstream(dir / "suite.toml") << "command = '''" + kDriver + "'''\n";
  }
  ~SourceModes() override { ::umask(umask_); }

  [[nodiscard]] std::vector<MadeBy> table() const {
    const std::string t = dir / "t";
    const std::string u = dir / "u";
    return {
        {{"cut", t, "--from", "0", "-o", "@"}, kTape},
        {{"split", t, "--every", "1", "-o", "@"}, {"@.1.logr", "@.1.loge", "@.2.logw"}},
        {{"merge", t, u, "-o", "@"}, kTape},
        {{"recover", t, "-o", "@"}, kTape},
        {{"redact", t, "--rules", dir / "secret.rules", "-o", "@", "--report", "@.json"},
         {"@.logr", "@.logw", "@.loge", "@.json"}},
        {{"convert", t, "-o", "@.txt"}, {"@.txt"}},
        {{"plot", t, "-o", "@.svg"}, {"@.svg"}},
        {{"view", t, "-o", "@.html"}, {"@.html"}},
        {{"diff", t, u, "--html", "@.html"}, {"@.html"}},
        {{"rules", "infer", t, dir / "other/v", "-o", "@.rules"}, {"@.rules"}},
        {{"pack", t, "-o", "@.tar.zst"}, {"@.tar.zst"}},
        {{"test", "--tape", t, "--report", "@.json", "--junit", "@.xml", "--", "sh", "-c", kDriver},
         {"@.json", "@.xml"},
         false},
        {{"test", "--suite", dir / "", "--junit", "@.xml"}, {"@.xml"}, false},
    };
  }

  static unsigned mode_of(const std::string& path) {
    struct stat status {};
    return ::stat(path.c_str(), &status) == 0 ? status.st_mode & 0777U : 0U;
  }
  void set_modes(const std::string& of, mode_t mode) const {
    for (const std::string name : {"t.log", "u.log"})
      ASSERT_EQ(::chmod((dir / (name + of)).c_str(), mode), 0) << name << of;
  }
  // The words with the new file's name in them.
  [[nodiscard]] std::vector<std::string> placed(std::vector<std::string> words,
                                                const std::string& name) const {
    for (std::string& word : words) {
      if (word.starts_with('@')) word.replace(0, 1, dir / name);
    }
    return words;
  }
  // Runs it for a new name. Returns the files' names.
  std::vector<std::string> make(const MadeBy& made, const std::string& name, bool overwrite = false) const {
    std::vector<std::string> args = placed(made.command, "out/" + name);
    if (overwrite && made.replaces) args.emplace_back("--overwrite");
    const Ran ran = run(args);
    EXPECT_TRUE(ran.status == 0 || ran.status == 3) << args[0] << ": " << ran.out << ran.err;
    return placed(made.files, "out/" + name);
  }
  // Those of the table, and what else makes a file or a folder that the user names.
  [[nodiscard]] std::vector<std::vector<std::string>> all_commands() const {
    const std::string t = dir / "t";
    std::vector<std::vector<std::string>> commands{
        {"unpack", dir / "p.tgz", "-o", "@"},
        {"convert", dir / "t.txt", "-o", "@"},
        {"record", "--device", "unix:" + (dir / "none"), "--tape", "@", "--", "true"},
        {"shrink", "--tape", t, "--faults", "drop:p=1", "-o", "@", "--", "sh", "-c", kDriver},
        {"drive", t, "--device", "unix:" + (dir / "none"), "--report", "@"},
        {"drive", t, "--device", "unix:" + (dir / "none"), "--junit", "@"},
        {"test", "--tape", t, "--junit", "@", "--", "sh", "-c", kDriver},
    };
    for (const MadeBy& made : table()) commands.push_back(made.command);
    return commands;
  }

  TempDir dir;

 private:
  mode_t umask_;
};

TEST_F(SourceModes, EachVerbKeepsFromOthersWhatAnySourceDoes) {
  struct Row {
    mode_t read, write, events;
    unsigned made;
  };
  int number = 0;
  for (const Row row :
       {Row{0644, 0644, 0644, 0640}, Row{0640, 0640, 0640, 0640}, Row{0600, 0600, 0600, 0600},
        Row{0644, 0600, 0644, 0600}, Row{0644, 0644, 0600, 0600}, Row{0604, 0644, 0644, 0600}}) {
    set_modes("r", row.read);
    set_modes("w", row.write);
    set_modes("e", row.events);
    for (const MadeBy& made : table()) {
      for (const std::string& file : make(made, "made" + std::to_string(number++)))
        EXPECT_EQ(mode_of(file), row.made) << made.command[0] << ' ' << made.command[1] << ' ' << file;
    }
  }
}

TEST_F(SourceModes, WhatIsReplacedIsKeptFromOthersAsItWas) {
  int number = 0;
  for (const MadeBy& made : table()) {
    const std::string name = "made" + std::to_string(number++);
    const std::vector<std::string> files = make(made, name);
    ASSERT_EQ(mode_of(files.front()), 0640U) << files.front();
    ASSERT_EQ(::chmod(files.front().c_str(), 0600), 0);
    make(made, name, true);
    EXPECT_EQ(mode_of(files.front()), 0600U) << files.front();
    // A tape's files are as strict as any of them was.
    if (made.files.front() == "@.logr") {
      EXPECT_EQ(mode_of(files.at(1)), 0600U) << files.at(1);
    }
  }
}

TEST_F(SourceModes, APackIsUnpackedForThosePeopleThatItIsFor) {
  for (const auto& [pack, folder, file] :
       {std::array{0644U, 0750U, 0640U}, std::array{0640U, 0750U, 0640U}, std::array{0600U, 0700U, 0600U}}) {
    ASSERT_EQ(run({"pack", dir / "t", "-o", dir / "p.tgz", "--overwrite"}).status, 0);
    ASSERT_EQ(::chmod((dir / "p.tgz").c_str(), pack), 0);
    const Ran ran = run({"unpack", dir / "p.tgz", "-o", dir / "unpacked"});
    ASSERT_EQ(ran.status, 0) << ran.err;
    EXPECT_EQ(mode_of(dir / "unpacked"), folder);
    for (const std::string name : {"manifest.json", "t.logr", "t.logw", "t.loge"})
      EXPECT_EQ(mode_of(dir / ("unpacked/" + name)), file) << name;
    fs::remove_all(dir / "unpacked");
    fs::remove(dir / "p.tgz");
  }
}

TEST_F(SourceModes, NothingIsMadeWhereAnotherUsersLinkLeads) {
  ASSERT_EQ(run({"pack", dir / "t", "-o", dir / "p.tgz"}).status, 0);
  ASSERT_EQ(run({"convert", dir / "t", "-o", dir / "t.txt"}).status, 0);
  fs::create_directories(dir / "theirs/deep");
  fs::create_symlink("theirs", dir / "link");
  const std::string link = dir / "link";
  if (::lchown(link.c_str(), 12345, 12345) != 0) GTEST_SKIP() << "needs root, to give a link away";
  for (const std::string to : {"link/x", "link/deep/x", "link/../link/deep/x"}) {
    for (const std::vector<std::string>& command : all_commands()) {
      const Ran ran = run(placed(command, to));
      EXPECT_EQ(ran.status, 2) << command[0] << ' ' << to << ": " << ran.out << ran.err;
      EXPECT_NE(ran.err.find("'link' on the way there is a link that another user made"), std::string::npos)
          << command[0] << ' ' << to << ": " << ran.err;
      for (const auto& entry : fs::recursive_directory_iterator(dir / "theirs"))
        EXPECT_EQ(entry.path().filename(), "deep") << command[0];
    }
  }
}

TEST_F(SourceModes, TheUsersOwnLinkLeadsThere) {
  ASSERT_EQ(run({"pack", dir / "t", "-o", dir / "p.tgz"}).status, 0);
  fs::create_symlink("out", dir / "link");
  int number = 0;
  for (const MadeBy& made : table()) {
    const std::string name = "made" + std::to_string(number++);
    const Ran ran = run(placed(made.command, "link/" + name));
    EXPECT_TRUE(ran.status == 0 || ran.status == 3) << made.command[0] << ": " << ran.out << ran.err;
    for (const std::string& file : placed(made.files, "out/" + name)) EXPECT_TRUE(fs::exists(file)) << file;
  }
  ASSERT_EQ(run({"unpack", dir / "p.tgz", "-o", dir / "link/unpacked"}).status, 0);
  EXPECT_TRUE(fs::exists(dir / "out/unpacked/manifest.json"));
}

}  // namespace
}  // namespace porttape::test
