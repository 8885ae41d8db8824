#include "daemon/control_protocol.hpp"

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
#include "tests/daemon/told_target.hpp"

namespace porttape {
namespace {

using test::ToldTarget;
using testing::HasSubstr;

TEST(ControlProtocol, EachVerbReachesItsTarget) {
  ToldTarget target;
  EXPECT_EQ(control_reply(target, R"({"verb":"status"})"), R"({"ok":true,"status":{"pid":7}})");
  EXPECT_EQ(control_reply(target, R"({"verb":"mark","text":"a \"b\"","channel":"x"})"),
            R"({"ok":true,"channels":["x"],"refused":[]})");
  EXPECT_EQ(control_reply(target, R"({"verb":"stop"})"),
            R"({"ok":true,"channels":["all"],"refused":[{"channel":"other","error":"no"}]})");
  EXPECT_EQ(target.calls, "mark(x,a \"b\") stop() ");
}

TEST(ControlReply, APlaybackRequestIsPassedOnAsNumbers) {
  ToldTarget target;
  for (const std::string_view line : {R"({"verb":"pause"})", R"({"verb":"resume","channel":"x"})",
                                      R"({"verb":"step"})", R"({"verb":"step","count":"3"})",
                                      R"({"verb":"seek","to":"12.5"})", R"({"verb":"rate","rate":"0.5"})"})
    EXPECT_NE(control_reply(target, line).find(R"("ok":true)"), std::string::npos) << line;
  EXPECT_EQ(target.calls,
            "pause(,1,0,1.000000) resume(x,1,0,1.000000) step(,1,0,1.000000) step(,3,0,1.000000) "
            "seek(,1,12500000,1.000000) rate(,1,0,0.500000) ");
}

TEST(ControlProtocol, WhatCannotBeDoneIsSaidWithItsReason) {
  ToldTarget target;
  target.error = make_error(Errc::io, "tape t.log has not begun");
  EXPECT_EQ(control_reply(target, R"({"verb":"mark","text":"a"})"),
            R"({"ok":false,"error":"tape t.log has not begun"})");
  target.error = make_error(Errc::usage, "there is no channel 'x'");
  EXPECT_EQ(control_reply(target, R"({"verb":"stop","channel":"x"})"),
            R"({"ok":false,"kind":"usage","error":"there is no channel 'x'"})");
}

TEST(ControlProtocol, WrongRequestsDoNothingAndSayWhatIsKnown) {
  ToldTarget target;
  const std::pair<std::string, std::string> wrong[] = {
      {"", "JSON object"},
      {"stop", "JSON object"},
      {"[]", "JSON object"},
      {R"({"verb":"stop"} x)", "JSON object"},
      {R"({})", "known: status, mark, pause, resume, step, seek, rate, stop"},
      {R"({"verb":"stopp"})",
       "unknown verb 'stopp'; known: status, mark, pause, resume, step, seek, rate, stop"},
      {R"({"verb":"stop","chanel":"x"})", "stop has no 'chanel'; it has: channel"},
      {R"({"verb":"status","channel":"x"})", "status has no 'channel'"},
      {R"({"verb":"stop","channel":5})", "'channel' must be a text"},
      {R"({"verb":"mark"})", "text is missing"},
      {R"({"verb":"pause","to":"1"})", "pause has no 'to'; it has: channel"},
      {R"({"verb":"step","count":"0"})", "'0'; accepted: 1 to 1000000"},
      {R"({"verb":"step","count":"-1"})", "'-1'; accepted: 1 to 1000000"},
      {R"({"verb":"seek"})", "seek: the time is missing"},
      {R"({"verb":"seek","to":"-1"})", "seek: the time is '-1'; accepted: seconds, 0 to 1000000000"},
      {R"({"verb":"seek","to":"later"})", "'later'; accepted: seconds"},
      {R"({"verb":"rate","rate":"0"})", "rate: the rate is '0'"},
      {R"({"verb":"mark","text":")" + std::string(kMaxEventText + 1, 'x') + R"("})", "at most 4096"},
      {std::string(10'000, '['), "JSON object"}};
  for (const auto& [line, why] : wrong) {
    const auto reply = boost::json::parse(control_reply(target, line)).as_object();
    EXPECT_FALSE(reply.at("ok").as_bool()) << line;
    EXPECT_EQ(reply.at("kind").as_string(), "usage") << line;
    EXPECT_THAT(std::string(reply.at("error").as_string().c_str()), HasSubstr(why)) << line;
  }
  EXPECT_EQ(target.calls, "");
}

}  // namespace
}  // namespace porttape
