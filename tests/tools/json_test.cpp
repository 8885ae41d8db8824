// JSON is stable (OUTPUT.md): what each verb prints of one small tape, whole.

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape {
namespace {

using test::make_tape;
using test::run;
using test::TempDir;

class Json : public testing::Test {
 protected:
  Json() {
    good_ =
        make_tape(dir_, "good", {{1'100'000, "T=20\n"}, {2'200'000, "ok\n"}, {4'100'000, "late\n"}},
                  {{1'000'000, "T?\n"}, {2'000'000, "GO\n"}, {4'000'000, "T?\n"}},
                  "{\"t_us\":0,\"event\":\"open\"}\n"
                  "{\"t_us\":500000,\"event\":\"settings\",\"by\":\"driver\",\"baud\":9600}\n"
                  "{\"t_us\":3000000,\"event\":\"mark\",\"text\":\"here\"}\n"
                  "{\"t_us\":3500000,\"event\":\"gap\",\"bytes\":5,\"from_us\":3200000,\"why\":\"disk\"}\n"
                  "{\"t_us\":5000000,\"event\":\"close\"}\n");
    bad_ = make_tape(dir_, "bad", {{1'100'000, "T=21\n"}, {2'900'000, "ok\n"}},
                     {{1'000'000, "T?\n"}, {2'000'000, "GO\n"}, {2'950'000, "BYE\n"}},
                     "{\"t_us\":0,\"event\":\"open\"}\n"
                     "{\"t_us\":500000,\"event\":\"settings\",\"by\":\"driver\",\"baud\":4800}\n"
                     "{\"t_us\":5000000,\"event\":\"close\"}\n");
  }

  std::string printed(const std::vector<std::string>& args) {
    std::string out = run(args).out;
    const std::string place = dir_.path().string();
    for (std::size_t at = out.find(place); at != std::string::npos; at = out.find(place, at))
      out.replace(at, place.size(), "DIR");
    return out;
  }

  TempDir dir_;
  std::string good_;
  std::string bad_;
};

TEST_F(Json, InfoTellsAllOfATape) {
  EXPECT_EQ(printed({"info", "--json", good_}),
            R"({"tape":"DIR/good.log","layout":"big-endian","duration_us":5000000,)"
            R"("read":{"file":"DIR/good.logr","file_bytes":49,"blocks":3,"bytes":13,"largest_block":5,)"
            R"("first_us":1100000,"last_us":4100000,"bytes_per_s":2.600000,"torn_bytes":0,"damage":null},)"
            R"("write":{"file":"DIR/good.logw","file_bytes":45,"blocks":3,"bytes":9,"largest_block":3,)"
            R"("first_us":1000000,"last_us":4000000,"bytes_per_s":1.800000,"torn_bytes":0,"damage":null},)"
            R"("exchanges":3,"answered":3,"latency_us":{"min":100000,"median":100000,"p99":200000,)"
            R"("max":200000},"session_count":1,"sessions":[{"open_us":0,"close_us":5000000,)"
            R"("duration_us":5000000,"read_bytes":13,"write_bytes":9}],"events":{"file":"DIR/good.loge",)"
            R"("created":"2024-05-06T07:08:09Z","device":"serial:/dev/ttyUSB0","driver":"pty:/tmp/x",)"
            R"("host":"bench","tool":"porttape 0.1.0","kinds":{"close":1,"gap":1,"mark":1,"open":1,)"
            R"("settings":1},"gap_bytes":5,"torn":false,"damage":null,"id":null,"zero":null,)"
            R"("transport":null,"stamped":null,"previous":null,"identity":null,"identity_refused":null,)"
            R"("origin":null,"gaps":[{"from_us":3200000,"t_us":3500000,"bytes":5,"why":"disk"}],)"
            R"("marks":[{"t_us":3000000,"text":"here"}],"settings":[{"t_us":500000,"event":"settings",)"
            R"("by":"driver","baud":9600}],"signals":[],"faults":[],"fault_kinds":{},"ended":false},)"
            R"("sound":false,"verdict":"no-damage-found","damages":[],)"
            R"("notes":["DIR/good.loge has no end: its recorder was killed, or it is shortened; a missing,)"
            R"( swapped, shortened or foreign file would not be seen",)"
            R"("DIR/good.loge: a gap from 3.200000 s to 3.500000 s, 5 bytes: disk"],"being_written":false})"
            "\n");
}

TEST_F(Json, CatHasALineForEachBurstAndEvent) {
  EXPECT_EQ(printed({"cat", "--json", good_}),
            R"({"t_us":0,"event":"open"})"
            "\n"
            R"({"t_us":500000,"event":"settings","by":"driver","baud":9600})"
            "\n"
            R"({"t_us":1000000,"until_us":1000000,"dir":"w","offset":0,"length":3,"blocks":1,)"
            R"("hex":"543f0a"})"
            "\n"
            R"({"t_us":1100000,"until_us":1100000,"dir":"r","offset":0,"length":5,"blocks":1,)"
            R"("hex":"543d32300a"})"
            "\n"
            R"({"t_us":2000000,"until_us":2000000,"dir":"w","offset":3,"length":3,"blocks":1,)"
            R"("hex":"474f0a"})"
            "\n"
            R"({"t_us":2200000,"until_us":2200000,"dir":"r","offset":5,"length":3,"blocks":1,)"
            R"("hex":"6f6b0a"})"
            "\n"
            R"({"t_us":3000000,"event":"mark","text":"here"})"
            "\n"
            R"({"t_us":3500000,"event":"gap","bytes":5,"from_us":3200000,"why":"disk"})"
            "\n"
            R"({"t_us":4000000,"until_us":4000000,"dir":"w","offset":6,"length":3,"blocks":1,)"
            R"("hex":"543f0a"})"
            "\n"
            R"({"t_us":4100000,"until_us":4100000,"dir":"r","offset":8,"length":5,"blocks":1,)"
            R"("hex":"6c6174650a"})"
            "\n"
            R"({"t_us":5000000,"event":"close"})"
            "\n");
}

TEST_F(Json, DiffHasALineForEachDifference) {
  EXPECT_EQ(printed({"diff", "--json", good_, bad_}),
            R"({"same":false,"one":{"tape":"good.log","exchanges":3,"turns":3,"events":5},)"
            R"("other":{"tape":"bad.log","exchanges":3,"turns":3,"events":3},"same_turns":1,)"
            R"("margin_us":100000,"events_compared":true,"counts":{"added":0,"missing":2,"changed":3,)"
            R"("moved":0,"slower":1,"faster":0}})"
            "\n"
            R"({"kind":"changed","one":{"t_us":500000,"event":{"t_us":500000,"event":"settings",)"
            R"("by":"driver","baud":9600}},"other":{"t_us":500000,"event":{"t_us":500000,)"
            R"("event":"settings","by":"driver","baud":4800}}})"
            "\n"
            R"({"kind":"changed","one":{"t_us":1000000,"until_us":1100000,"exchange":1,"part":0,)"
            R"("unasked":false,"write_bytes":3,"read_bytes":5,"wait_us":1000000,"answer_us":100000,)"
            R"("write_hex":"543f0a","read_hex":"543d32300a"},"other":{"t_us":1000000,"until_us":1100000,)"
            R"("exchange":1,"part":0,"unasked":false,"write_bytes":3,"read_bytes":5,"wait_us":1000000,)"
            R"("answer_us":100000,"write_hex":"543f0a","read_hex":"543d32310a"},"dir":"r","offset":3,)"
            R"("one_hex":"300a","other_hex":"310a"})"
            "\n"
            R"({"kind":"slower","time":"answer","one":{"t_us":2000000,"until_us":2200000,"exchange":2,)"
            R"("part":0,"unasked":false,"write_bytes":3,"read_bytes":3,"wait_us":900000,"answer_us":200000,)"
            R"("write_hex":"474f0a","read_hex":"6f6b0a"},"other":{"t_us":2000000,"until_us":2900000,)"
            R"("exchange":2,"part":0,"unasked":false,"write_bytes":3,"read_bytes":3,"wait_us":900000,)"
            R"("answer_us":900000,"write_hex":"474f0a","read_hex":"6f6b0a"}})"
            "\n"
            R"({"kind":"missing","one":{"t_us":3000000,"event":{"t_us":3000000,"event":"mark",)"
            R"("text":"here"}},"other":null})"
            "\n"
            R"({"kind":"missing","one":{"t_us":3500000,"event":{"t_us":3500000,"event":"gap","bytes":5,)"
            R"("from_us":3200000,"why":"disk"}},"other":null})"
            "\n"
            R"({"kind":"changed","one":{"t_us":4000000,"until_us":4100000,"exchange":3,"part":0,)"
            R"("unasked":false,"write_bytes":3,"read_bytes":5,"wait_us":1800000,"answer_us":100000,)"
            R"("write_hex":"543f0a","read_hex":"6c6174650a"},"other":{"t_us":2950000,"until_us":2950000,)"
            R"("exchange":3,"part":0,"unasked":false,"write_bytes":4,"read_bytes":0,"wait_us":50000,)"
            R"("answer_us":null,"write_hex":"4259450a","read_hex":""},"dir":"w","offset":0,)"
            R"("one_hex":"543f0a","other_hex":"4259450a"})"
            "\n");
}

TEST_F(Json, StatsCountEachCommand) {
  EXPECT_EQ(printed({"stats", "--json", good_}),
            R"({"tape":"good.log","duration_us":5000000,"exchanges":3,"answered":3,)"
            R"("answer_us":{"min":100000,"median":100000,"p90":200000,"p99":200000,"max":200000},)"
            R"("read":{"blocks":3,"bytes":13,"busiest_second_bytes":5,"busiest_second_us":1000000,)"
            R"("stray_bytes":0,"commands":[]},"write":{"blocks":3,"bytes":9,"busiest_second_bytes":3,)"
            R"("busiest_second_us":1000000,"stray_bytes":0,"commands":[{"command":"T","count":2,"bytes":6,)"
            R"("unanswered":0,"answer_us":{"min":100000,"median":100000,"p90":100000,"p99":100000,)"
            R"("max":100000},"longest_at_us":1000000},{"command":"GO","count":1,"bytes":3,"unanswered":0,)"
            R"("answer_us":{"min":200000,"median":200000,"p90":200000,"p99":200000,"max":200000},)"
            R"("longest_at_us":2000000}]},"silence_us":1000000,"silences":2,"silent_us":2800000,)"
            R"("longest_silences":[{"from_us":2200000,"length_us":1800000},{"from_us":0,)"
            R"("length_us":1000000}],"slowest":[{"exchange":2,"t_us":2000000,"until_us":2200000,)"
            R"("answer_us":200000,"written":3,"read":3,"command":"GO"},{"exchange":1,"t_us":1000000,)"
            R"("until_us":1100000,"answer_us":100000,"written":3,"read":5,"command":"T"},{"exchange":3,)"
            R"("t_us":4000000,"until_us":4100000,"answer_us":100000,"written":3,"read":5,"command":"T"}]})"
            "\n");
}

TEST_F(Json, RulesCheckSaysWhereEachRuleIs) {
  test::write_file(dir_ / "my.rules",
                   test::bytes_of("[[frame]]\nname = 'line'\nkind = 'delimited'\nend = \"\\n\"\n"
                                  "[[rule]]\nname = 'a'\nwhen = '^T'\nat = 0\nsize = 1\nignore = true\n"
                                  "[[rule]]\nname = 'b'\nat = 0\nsize = 2\nignore = true\n"));
  EXPECT_EQ(printed({"rules", "check", "--json", good_, dir_ / "my.rules"}),
            R"({"tape":"DIR/good.log","file":"DIR/my.rules","ok":false,"frames":3,)"
            R"("formats":[{"name":"line","frames":3,"checksum_held":0,"checksum_wrong":0}],)"
            R"("rules":[{"name":"a","line":5,"use":{"count":2,"first":{"t_us":1000000,"offset":0,)"
            R"("exchange":1,"frame_hex":"543f0a","begin":0,"end":1}}},{"name":"b","line":11,)"
            R"("use":{"count":3,"first":{"t_us":1000000,"offset":0,"exchange":1,"frame_hex":"543f0a",)"
            R"("begin":0,"end":3}}}],"replies":[],"overlaps":[{"rule":"a","other":"b","use":{"count":2,)"
            R"("first":{"t_us":1000000,"offset":0,"exchange":1,"frame_hex":"543f0a","begin":0,"end":3}}}],)"
            R"("untouched":{"count":0,"first":null},"unframed_bytes":{"count":0,"first":null}})"
            "\n");
}

}  // namespace
}  // namespace porttape
