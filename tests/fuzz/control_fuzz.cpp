// Any lines to the control socket: each gets one reply, a JSON object in a line of its own, whatever it
// holds, and only a request that is right does anything.

#include <string>
#include <string_view>

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>

#include "daemon/control_protocol.hpp"
#include "libport/tape/event.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace {

using namespace porttape;
using namespace porttape::test;

class Target final : public ControlTarget {
 public:
  [[nodiscard]] std::string status() const override {
    ++calls;
    return "{}";
  }
  Result<Outcome> record(const std::string& channel, const RecorderRequest& what) override {
    const std::string& text = std::get<line::Mark>(what.note.value()).text;
    require(!text.empty() && text.size() <= kMaxEventText, "a mark has a text of its size");
    return outcome(channel);
  }
  Result<Outcome> play(const std::string& channel, const PlaybackRequest& what) override {
    require(what.rate > 0 && what.exchanges > 0 && what.to >= Micros{}, "only good requests come through");
    return outcome(channel);
  }
  Result<Outcome> stop(const std::string& channel) override { return outcome(channel); }

  mutable int calls = 0;

 private:
  Result<Outcome> outcome(const std::string& channel) {
    ++calls;
    if (channel.starts_with('x')) return make_error(Errc::usage, "there is no channel '" + channel + "'");
    return Outcome{{channel}, {{"other", channel}}};
  }
};

void check(std::string_view line) {
  Target target;
  const std::string reply = control_reply(target, line);
  require(reply.find('\n') == std::string::npos, "a reply is one line");
  boost::json::error_code failed;
  const boost::json::value value = boost::json::parse(reply, failed);
  require(!failed && value.is_object(), "a reply is a JSON object in UTF-8");
  const boost::json::value* ok = value.get_object().if_contains("ok");
  require(ok != nullptr && ok->is_bool(), "a reply says whether it was done");
  require(ok->get_bool() || value.get_object().contains("error"), "a refusal has its reason");
  require(target.calls <= 1, "a request is carried out once");
  require(target.calls == 1 || !ok->get_bool(), "what did nothing is no success");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view rest = Input(data, size).rest();
  while (!rest.empty()) {
    const std::size_t end = rest.find('\n');
    check(rest.substr(0, end));
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
  }
  return 0;
}
