#include "libport/faults/fault_plan.hpp"

#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

std::string text_of(const std::string& written, std::optional<LineDir> dir = {}) {
  const Result<FaultPlan> plan = parse_fault_plan(written, dir);
  return plan ? plan->text() : plan.error().message;
}

TEST(FaultPlan, ReadsTheFormOfTheContract) {
  const Result<FaultPlan> plan =
      parse_fault_plan("drop:p=0.01;corrupt:p=0.001,dir=r;stall:at=12.5,for=2", {});
  ASSERT_TRUE(plan.has_value());
  ASSERT_EQ(plan->faults.size(), 3U);
  EXPECT_EQ(plan->faults[0], (Fault{.kind = Fault::Kind::drop, .chance = 0.01}));
  EXPECT_EQ(plan->faults[1].dir, LineDir::r);
  EXPECT_EQ(plan->faults[2].at, milliseconds(12'500));
  EXPECT_EQ(plan->faults[2].length, milliseconds(2'000));
}

TEST(FaultPlan, WhatSaysNoDirectionHasTheOneGiven) {
  EXPECT_EQ(text_of("drop:p=0.5"), "drop:p=0.5:dir=both");
  EXPECT_EQ(text_of("drop:p=0.5", LineDir::r), "drop:p=0.5:dir=r");
  EXPECT_EQ(text_of("drop:p=0.5,dir=both", LineDir::r), "drop:p=0.5:dir=both");
}

TEST(FaultPlan, IsWrittenAsItIsRead) {
  for (const char* const text :
       {"drop:p=1e-05:dir=both:per=frame:burst=3:times=2", "corrupt:byte=7:dir=w:xor=01ff",
        "duplicate:frame=2:dir=r:per=frame:end=0d0a", "delay:p=0.25:dir=r:for=0.001",
        "stall:at=12.5:dir=both:for=2", "truncate:frame=3:dir=r:size=12:keep=4", "hangup:at=0",
        "hangup:byte=4:dir=r", "replug:at=1.5:for=0.25", "drop:p=0:dir=r;drop:p=1:dir=w"}) {
    EXPECT_EQ(text_of(text), text);
  }
}

TEST(FaultPlan, LinesBlanksAndCommentsAreFree) {
  EXPECT_EQ(text_of("# a bad cable\n drop : p = 0.5 , dir=r ; \r\n\n;hangup:at=1 # here\n"),
            "drop:p=0.5:dir=r;hangup:at=1");
}

TEST(FaultPlan, ErrorsNameKindKeyValueAndWhatIsAccepted) {
  EXPECT_EQ(text_of("dorp:p=1"), "unknown fault 'dorp'; did you mean 'drop'?");
  EXPECT_EQ(text_of("drop:p=2"), "fault 'drop': key 'p' is '2'; accepted: a probability, 0 to 1");
  EXPECT_EQ(text_of("drop:p="), "fault 'drop': key 'p' is ''; accepted: a probability, 0 to 1");
  EXPECT_EQ(text_of("drop:p=nan"), "fault 'drop': key 'p' is 'nan'; accepted: a probability, 0 to 1");
  EXPECT_EQ(text_of("drop:p=0.1,brust=2"), "fault 'drop': unknown key 'brust'; did you mean 'burst'?");
  EXPECT_EQ(text_of("stall:at=-1"), "fault 'stall': key 'at' is '-1'; accepted: seconds, 0 to 1000000000");
  EXPECT_EQ(text_of("stall:at=1,for=0"),
            "fault 'stall': key 'for' is '0'; accepted: seconds, more than 0, up to 86400");
  EXPECT_EQ(text_of("corrupt:p=1,xor=00"),
            "fault 'corrupt': key 'xor' is '00'; accepted: 1 to 64 bytes in hex, two digits each, none 00");
  EXPECT_EQ(text_of("drop:p=1,p=1"), "fault 'drop': key 'p' is there twice");
  EXPECT_EQ(text_of("drop"), "fault 'drop': it does not say when; accepted: one of p, byte, frame, at");
  EXPECT_EQ(text_of("drop:p=1,at=2"),
            "fault 'drop': it says more than once when; accepted: one of p, byte, frame, at");
  EXPECT_EQ(text_of("drop:p=1;\nhangup:frame=0"),
            "line 2: fault 'hangup': key 'frame' is '0'; accepted: the number of a frame, 1 or more");
  EXPECT_NE(text_of("# nothing").find("no fault in it"), std::string::npos);
  EXPECT_NE(text_of("drop:p=1,end=0a,size=2").find("accepted: one of them"), std::string::npos);
  EXPECT_NE(text_of("truncate:byte=1,keep=2").find("'keep' goes with p and frame"), std::string::npos);
  EXPECT_NE(text_of("stall:p=0.1,xor=01").find("unknown key 'xor'"), std::string::npos);
}

TEST(FaultPlan, ThereIsALimitToItsLength) {
  std::string text;
  for (std::size_t n = 0; n < FaultPlan::kMostFaults; ++n) text += "drop:p=0;";
  EXPECT_TRUE(parse_fault_plan(text, {}).has_value());
  EXPECT_FALSE(parse_fault_plan(text + "drop:p=0", {}).has_value());
}

class FaultPlanFile : public testing::Test {
 protected:
  std::string message(const std::string& name) {
    const Result<FaultPlan> plan = load_fault_plan(name, {});
    return plan ? plan->text() : plan.error().message;
  }
  std::string file(const std::string& name, const std::string& text) {
    const std::string path = (folder.path() / name).string();
    std::ofstream(path) << text;
    return path;
  }
  test::TempDir folder;
};

TEST_F(FaultPlanFile, IsReadLikeTheText) {
  EXPECT_EQ(message(file("plan", "drop:p=0.5\n# and\nhangup:at=3\n")), "drop:p=0.5:dir=both;hangup:at=3");
}

TEST_F(FaultPlanFile, ErrorsNameFileAndLine) {
  const std::string path = file("plan", "drop:p=0.5\ndrop:q=1\n");
  EXPECT_EQ(message(path), "file '" + path +
                               "': line 2: fault 'drop': unknown key 'q'; accepted: p, byte, "
                               "frame, at, dir, per, end, size, burst, times");
  EXPECT_NE(message((folder.path() / "none").string()).find("cannot be read"), std::string::npos);
  EXPECT_NE(message(folder.path().string()).find("is no regular file"), std::string::npos);
  EXPECT_NE(message(file("large", std::string((1U << 20U) + 1, '#'))).find("more than 1 MiB"),
            std::string::npos);
  EXPECT_NE(message(file("empty", "")).find("no fault in it"), std::string::npos);
  EXPECT_NE(message("plan.txt").find("no file of that name"), std::string::npos);
}

}  // namespace
}  // namespace porttape
