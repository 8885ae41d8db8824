#include "tools/output.hpp"

#include <array>
#include <csignal>
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/base/version.hpp"
#include "tests/support/help_width.hpp"
#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::run;
using testing::HasSubstr;

// Runs the program, its standard output on `out`; gives the wait status.
int run_program(std::string verb, std::string tape, int out, bool ignore_sigpipe) {
  const pid_t child = ::fork();
  if (child == 0) {
    std::string program = PORTTAPE_PROGRAM;
    const std::array<char*, 4> argv{program.data(), verb.data(), tape.data(), nullptr};
    ::signal(SIGPIPE, ignore_sigpipe ? SIG_IGN : SIG_DFL);
    ::dup2(out, STDOUT_FILENO);
    ::close(STDERR_FILENO);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  int status = -1;
  ::waitpid(child, &status, 0);
  return status;
}

std::string long_tape(const test::TempDir& dir) {
  std::vector<test::Block> blocks;
  for (int i = 0; i < 10'000; ++i) blocks.push_back({i * 1000, "some data to print"});
  return test::make_tape(dir, "t", blocks, {});
}

TEST(Program, ADiskThatIsFullOnStandardOutputIs1) {
  const test::TempDir dir;
  const UniqueFd full(::open("/dev/full", O_WRONLY | O_CLOEXEC));
  const int status = run_program("cat", long_tape(dir), full.get(), false);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 1);
}

TEST(Program, ADifferenceThatIsNotWrittenIs1) {
  const test::TempDir dir;
  const std::string one = test::make_tape(dir, "a", {{1, "a"}}, {});
  const std::string other = test::make_tape(dir, "b", {{1, "b"}}, {});
  const UniqueFd full(::open("/dev/full", O_WRONLY | O_CLOEXEC));
  FdStreambuf buffer(full.get());
  std::ostream out(&buffer);
  std::ostringstream err;
  const std::vector<std::string> args{"diff", one, other, "--json"};
  EXPECT_EQ(run_porttape(args, out, err), 1);
}

TEST(Program, AReaderThatGoesAwayIsNoError) {
  const test::TempDir dir;
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
  ::close(ends[0]);
  const UniqueFd out(ends[1]);
  const int ignored = run_program("cat", long_tape(dir), out.get(), true);
  EXPECT_TRUE(WIFEXITED(ignored));
  EXPECT_EQ(WEXITSTATUS(ignored), 0);
  const int by_signal = run_program("cat", long_tape(dir), out.get(), false);
  EXPECT_TRUE(WIFSIGNALED(by_signal));
  EXPECT_EQ(WTERMSIG(by_signal), SIGPIPE);
}

TEST(Output, ColoursAreForTerminalsOnly) {
  std::ostringstream text;
  EXPECT_FALSE(wants_color(text));
  const UniqueFd null(::open("/dev/null", O_WRONLY | O_CLOEXEC));
  FdStreambuf buffer(null.get());
  const std::ostream out(&buffer);
  EXPECT_FALSE(wants_color(out));

  const UniqueFd master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_TRUE(master);
  FdStreambuf tty_buffer(master.get());
  const std::ostream tty(&tty_buffer);
  ::unsetenv("NO_COLOR");
  EXPECT_TRUE(wants_color(tty));
  ::setenv("NO_COLOR", "1", 1);
  EXPECT_FALSE(wants_color(tty));
  ::unsetenv("NO_COLOR");
}

TEST(Porttape, HelpAndVersionGoToStandardOutput) {
  EXPECT_EQ(run({"--version"}).out, "porttape " + std::string(version()) + "\n");
  const auto help = run({"--help"});
  EXPECT_EQ(help.status, 0);
  EXPECT_EQ(test::first_long_line(help.out), "");
  EXPECT_EQ(test::first_long_line(run({"--help-ports"}).out), "");
  for (const Verb& verb : verbs()) {
    EXPECT_THAT(help.out, HasSubstr("  " + std::string(verb.name) + " "));
    const auto verb_help = run({std::string(verb.name), "--help"});
    EXPECT_EQ(verb_help.status, 0);
    EXPECT_THAT(verb_help.out, HasSubstr("Example"));
    EXPECT_EQ(verb_help.err, "");
    EXPECT_EQ(test::first_long_line(verb_help.out), "");
    EXPECT_EQ(run({std::string(verb.name), "-h"}).out, verb_help.out);
  }
}

TEST(Porttape, WhatItDoesNotKnowIs2AndOneLine) {
  for (const std::vector<std::string>& args :
       std::vector<std::vector<std::string>>{{}, {"frobnicate"}, {"--frobnicate"}, {"-x"}, {""}}) {
    const auto ran = run(args);
    EXPECT_EQ(ran.status, 2);
    EXPECT_EQ(ran.out, "");
    EXPECT_THAT(ran.err, testing::MatchesRegex("porttape: [^\n]*; see porttape --help\n"));
  }
}

TEST(Porttape, TheLineThatWasMeantIsNamed) {
  EXPECT_EQ(run({"inof"}).err, "porttape: unknown verb 'inof'; did you mean 'info'?\n");
  EXPECT_EQ(run({"-V"}).err, "porttape: unknown option '-V'; did you mean '--version'?\n");
  EXPECT_EQ(run({"version"}).err, "porttape: unknown verb 'version'; did you mean '--version'?\n");
  EXPECT_EQ(run({"--json", "info", "a b"}).err,
            "porttape: '--json' belongs behind the verb: porttape info --json 'a b'\n");
  EXPECT_EQ(run({"help", "cat"}).out, run({"cat", "--help"}).out);
  EXPECT_EQ(run({"--ver"}).err, "porttape: unknown option '--ver'; did you mean '--version'?\n");
  EXPECT_EQ(run({"laser.log"}).err,
            "porttape: unknown verb 'laser.log'; did you mean 'porttape info laser.log'?\n");
  EXPECT_EQ(run({"replay", "--tape", "a b"}).err,
            "porttape: 'replay' is a verb of porttaped: porttaped replay --tape 'a b'\n");
  EXPECT_EQ(run({"cat", "--form", "1", "x"}).err,
            "porttape cat: unknown option '--form'; did you mean '--from'?\n");
}

// A verb that runs a command has no control socket: a clock that stands would stand for ever.
TEST(Porttape, WhatOnlyADaemonIsSteeredByIsNoOptionOfAVerbThatRunsACommand) {
  for (const std::string verb : {"test", "exec", "drive", "soak", "shrink", "bless"}) {
    const test::Ran tried = run({verb, "--tape", "nothing", "--start-paused", "--", "true"});
    EXPECT_EQ(tried.status, 2) << verb;
    EXPECT_THAT(tried.err, HasSubstr("unknown option '--start-paused'")) << verb;
  }
}

}  // namespace
}  // namespace porttape
