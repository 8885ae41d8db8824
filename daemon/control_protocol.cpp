// The lines of the control socket: CONTROL.md.

#include "daemon/control_protocol.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <map>
#include <span>

#include <boost/json/parse.hpp>
#include <boost/json/value.hpp>

#include "libport/base/json_object.hpp"
#include "libport/base/json_text.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/port/port_type.hpp"
#include "libport/tape/event.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

using Values = std::map<std::string, std::string, std::less<>>;
using Reply = Result<std::string>;

std::string value_of(const Values& values, std::string_view key) {
  const auto given = values.find(key);
  return given == values.end() ? std::string() : given->second;
}

Reply reply_of(const Result<ControlTarget::Outcome>& outcome) {
  if (!outcome) return outcome.error();
  JsonList done;
  for (const std::string& channel : outcome->done) done.add(channel);
  JsonList refused;
  for (const auto& [channel, why] : outcome->refused) {
    JsonObject each;
    each.add("channel", channel).add("error", why);
    refused.add(each);
  }
  JsonObject reply;
  reply.add_raw("ok", "true").add("channels", done).add("refused", refused);
  return reply.str();
}

Reply status(ControlTarget& target, const Values&) {
  JsonObject reply;
  reply.add_raw("ok", "true").add_raw("status", target.status());
  return reply.str();
}

Reply mark(ControlTarget& target, const Values& values) {
  const std::string text = value_of(values, "text");
  if (text.empty()) return usage_error("mark: the text is missing");
  if (text.size() > kMaxEventText)
    return usage_error(
        fmt::format("mark: the text has {} bytes; at most {} fit", text.size(), kMaxEventText));
  return reply_of(target.record(value_of(values, "channel"), RecorderRequest::mark(text)));
}

Reply play(ControlTarget& target, const Values& values, const PlaybackRequest& what) {
  return reply_of(target.play(value_of(values, "channel"), what));
}

Reply pause(ControlTarget& target, const Values& values) {
  return play(target, values, {.kind = PlaybackRequest::Kind::pause});
}

Reply resume(ControlTarget& target, const Values& values) {
  return play(target, values, {.kind = PlaybackRequest::Kind::resume});
}

Reply step(ControlTarget& target, const Values& values) {
  PlaybackRequest request{.kind = PlaybackRequest::Kind::step};
  if (const std::string given = value_of(values, "count"); !given.empty()) {
    const auto count = whole_number<std::uint64_t>(given);
    if (!count || *count < 1 || *count > 1'000'000)
      return usage_error(
          fmt::format("step: the number of exchanges is {}; accepted: 1 to 1000000", in_quotes(given)));
    request.exchanges = *count;
  }
  return play(target, values, request);
}

// A number of a request, within both.
Result<double> number(const Values& values, std::string_view verb, std::string_view key,
                      const OptionSpec& spec) {
  const std::string given = value_of(values, key);
  if (given.empty())
    return usage_error(
        fmt::format("{}: the {} is missing; accepted: {}", verb, spec.name, accepted_by(spec)));
  const Result<std::string> value = check_value(spec, given);
  if (!value)
    return usage_error(
        fmt::format("{}: the {} is {}; accepted: {}", verb, spec.name, in_quotes(given), accepted_by(spec)));
  return std::stod(*value);
}

Reply seek(ControlTarget& target, const Values& values) {
  const OptionSpec time{.name = "time", .kind = OptionSpec::Kind::number, .max = 1e9, .unit = "s"};
  const Result<double> to = number(values, "seek", "to", time);
  if (!to) return to.error();
  return play(
      target, values,
      {.kind = PlaybackRequest::Kind::seek, .to = Micros(static_cast<std::int64_t>(*to * 1e6 + 0.5))});
}

Reply rate(ControlTarget& target, const Values& values) {
  const OptionSpec spec{.name = "rate", .kind = OptionSpec::Kind::number, .min = 1e-6, .max = 1e6};
  const Result<double> rate = number(values, "rate", "rate", spec);
  if (!rate) return rate.error();
  return play(target, values, {.kind = PlaybackRequest::Kind::rate, .rate = *rate});
}

Reply stop(ControlTarget& target, const Values& values) {
  return reply_of(target.stop(value_of(values, "channel")));
}

// A verb is its row here, what it asks of a ControlTarget, and its row in CONTROL.md.
struct Verb {
  std::string_view name;
  std::span<const std::string_view> keys;  // besides `verb`
  Reply (*run)(ControlTarget& target, const Values& values);
};

constexpr std::array<std::string_view, 2> kMarkKeys = {"channel", "text"};
constexpr std::array<std::string_view, 1> kStopKeys = {"channel"};  // of pause and resume, too
constexpr std::array<std::string_view, 2> kStepKeys = {"channel", "count"};
constexpr std::array<std::string_view, 2> kSeekKeys = {"channel", "to"};
constexpr std::array<std::string_view, 2> kRateKeys = {"channel", "rate"};
constexpr std::array kVerbs = {
    Verb{"status", {}, status},        Verb{"mark", kMarkKeys, mark}, Verb{"pause", kStopKeys, pause},
    Verb{"resume", kStopKeys, resume}, Verb{"step", kStepKeys, step}, Verb{"seek", kSeekKeys, seek},
    Verb{"rate", kRateKeys, rate},     Verb{"stop", kStopKeys, stop},
};

template <class Names>
std::string joined(const Names& names) {
  return fmt::format("{}", fmt::join(names, ", "));
}

Result<Values> values_of(std::string_view line) {
  json::error_code failed;
  const json::value value = json::parse({line.data(), line.size()}, failed);
  const json::object* object = failed ? nullptr : value.if_object();
  if (object == nullptr)
    return usage_error("a request is a line with a JSON object in UTF-8, as {\"verb\":\"status\"}");
  Values values;
  for (const auto& [key, member] : *object) {
    const json::string* text = member.if_string();
    const std::string name(key.data(), key.size());
    if (text == nullptr) return usage_error(fmt::format("'{}' must be a text", name));
    values[name] = std::string(text->data(), text->size());
  }
  return values;
}

Reply reply_to(ControlTarget& target, std::string_view line) {
  const Result<Values> values = values_of(line);
  if (!values) return values.error();
  const std::string name = value_of(*values, "verb");
  const auto* verb = std::ranges::find(kVerbs, name, &Verb::name);
  if (verb == kVerbs.end()) {
    std::array<std::string_view, kVerbs.size()> names;
    std::ranges::transform(kVerbs, names.begin(), &Verb::name);
    return usage_error(name.empty() ? fmt::format("'verb' is missing; known: {}", joined(names))
                                    : fmt::format("unknown verb '{}'; known: {}", name, joined(names)));
  }
  for (const auto& [key, value] : *values) {
    if (key == "verb" || std::ranges::find(verb->keys, key) != verb->keys.end()) continue;
    return usage_error(verb->keys.empty()
                           ? fmt::format("{} has no '{}'", name, key)
                           : fmt::format("{} has no '{}'; it has: {}", name, key, joined(verb->keys)));
  }
  return verb->run(target, *values);
}

}  // namespace

std::string control_error(std::string_view why) {
  JsonObject reply;
  reply.add_raw("ok", "false").add("error", why);
  return reply.str();
}

std::string control_usage_error(std::string_view why) {
  JsonObject reply;
  reply.add_raw("ok", "false").add("kind", "usage").add("error", why);
  return reply.str();
}

std::string control_reply(ControlTarget& target, std::string_view line) {
  const Reply reply = reply_to(target, line);
  if (reply) return *reply;
  return reply.error().code == Errc::usage ? control_usage_error(reply.error().message)
                                           : control_error(reply.error().message);
}

}  // namespace porttape
