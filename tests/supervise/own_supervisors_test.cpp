// A program that wants to supervise calls itself.

#include "libport/supervise/own_supervisors.hpp"

#include <linux/seccomp.h>
#include <memory>
#include <optional>
#include <string>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/supervise/supervised_command.hpp"

namespace porttape {
namespace {

class OwnSupervisorsTest : public testing::Test {
 protected:
  // The errno of each of these calls of seccomp(2), in a program's exit status of one digit for each: 1 is
  // EBUSY, 2 EFAULT, 0 another or none.
  int run(const std::vector<std::pair<unsigned long, unsigned long>>& calls) {
    std::string program = "my $end = 0; my $got;\n";
    for (const auto& [operation, flags] : calls) {
      program += "$! = 0; syscall(" + std::to_string(SYS_seccomp) + ", " + std::to_string(operation) + ", " +
                 std::to_string(flags) + ", 0); $end = $end * 3 + ($!{EBUSY} ? 1 : $!{EFAULT} ? 2 : 0);\n";
    }
    Loop loop;
    std::vector<std::unique_ptr<CallPart>> parts;
    parts.push_back(
        std::make_unique<OwnSupervisors>([this](const std::string& what) { told.push_back(what); }));
    std::optional<int> status;
    SupervisedCommand::Trouble trouble;
    const auto running = SupervisedCommand::start(
        loop,
        {.command = {"perl", "-MErrno", "-e", program + "exit $end"},
         .environment = {"PATH=/usr/bin:/bin"},
         .traps = Supervisor::traps(parts)},
        [&](int wait_status) { status = wait_status; }, trouble);
    if (!running) return -1;
    const Supervisor supervisor(loop, running->take_listener(), std::move(parts));
    while (!status) loop.run_one();
    return WEXITSTATUS(*status);
  }
  std::vector<std::string> told;
};

constexpr unsigned long kListener = SECCOMP_FILTER_FLAG_NEW_LISTENER;

TEST_F(OwnSupervisorsTest, ItIsRefusedAndToldOnce) {
  EXPECT_EQ(run({{SECCOMP_SET_MODE_FILTER, kListener}, {SECCOMP_SET_MODE_FILTER, kListener | 1}}), 1 * 3 + 1);
  EXPECT_THAT(told, testing::ElementsAre(testing::HasSubstr("wants to supervise calls itself")));
}

TEST_F(OwnSupervisorsTest, OtherFiltersAreTheKernels) {
  EXPECT_EQ(run({{SECCOMP_SET_MODE_FILTER, 0}, {SECCOMP_GET_ACTION_AVAIL, 0}}), 2 * 3 + 2);
  EXPECT_EQ(run({{SECCOMP_GET_ACTION_AVAIL, kListener}}), 0);
  EXPECT_THAT(told, testing::IsEmpty());
}

}  // namespace
}  // namespace porttape
