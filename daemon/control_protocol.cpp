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
#include "libport/tape/event.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

using Values = std::map<std::string, std::string, std::less<>>;
using Reply = Result<std::string>;

Error usage(std::string message) { return make_error(Errc::usage, std::move(message)); }

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
  if (text.empty()) return usage("mark: the text is missing");
  if (text.size() > kMaxEventText)
    return usage(fmt::format("mark: the text has {} bytes; at most {} fit", text.size(), kMaxEventText));
  return reply_of(target.mark(value_of(values, "channel"), text));
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
constexpr std::array<std::string_view, 1> kStopKeys = {"channel"};
constexpr std::array kVerbs = {
    Verb{"status", {}, status},
    Verb{"mark", kMarkKeys, mark},
    Verb{"stop", kStopKeys, stop},
};

template <class Names>
std::string joined(const Names& names) {
  return fmt::format("{}", fmt::join(names, ", "));
}

Result<Values> values_of(std::string_view line) {
  json::error_code failed;
  const json::value value = json::parse({line.data(), line.size()}, failed);
  const json::object* object = failed ? nullptr : value.if_object();
  if (object == nullptr) return usage("a request is a line with a JSON object, as {\"verb\":\"status\"}");
  Values values;
  for (const auto& [key, member] : *object) {
    const json::string* text = member.if_string();
    const std::string name(key.data(), key.size());
    if (text == nullptr) return usage(fmt::format("'{}' must be a text", name));
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
    return usage(name.empty() ? fmt::format("'verb' is missing; known: {}", joined(names))
                              : fmt::format("unknown verb '{}'; known: {}", name, joined(names)));
  }
  for (const auto& [key, value] : *values) {
    if (key == "verb" || std::ranges::find(verb->keys, key) != verb->keys.end()) continue;
    return usage(verb->keys.empty()
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
