#include <algorithm>
#include <array>
#include <chrono>
#include <fmt/format.h>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "libport/base/nearest.hpp"
#include "libport/base/printable.hpp"
#include "tools/command_line.hpp"
#include "tools/control_client.hpp"
#include "tools/verb_clock.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

constexpr VerbHelp kCtlHelp{
    "ctl",
    "[-c CHANNEL] [-p PID] [--user NAME|all] mark TEXT | pause | resume | step [N] | seek SEC | rate X | "
    "stop",
    "Steers a daemon that runs: the one of that process or with that channel, or the only one.\n"
    "  mark TEXT  notes the text on the tapes that are being recorded, in its place among the\n"
    "             bytes; `porttape cat` and `info` show it\n"
    "  stop       ends it as SIGTERM does, or that channel alone, and waits for the end; given\n"
    "             again meanwhile, it ends at once\n"
    "A tape that is replayed:\n"
    "  pause      its clock stands: nothing is delivered, nothing counts as late; what the\n"
    "             driver writes is compared all the same\n"
    "  resume     its clock goes on\n"
    "  step [N]   while it is paused: the next answer, or N of them, at once, each up to the\n"
    "             driver's next write; of a device that speaks unasked, a second of the tape\n"
    "  seek SEC   goes on at that time of the tape; the writes between are neither expected nor\n"
    "             missing\n"
    "  rate X     from now on time runs X times as fast\n"
    "The report of a run says what was done to it; `porttape status` says where it is.\n"
    "Exit status: 0, 1 it could not be done, 2 wrong usage, or it is not clear which is meant.\n",
    "  porttape ctl mark arm is moving\n"
    "  porttape ctl seek 12.5\n"
    "  porttape ctl -c laser stop\n"};

// A daemon ends within some 15 s, whatever its lines and disks do.
constexpr std::chrono::seconds kEndLimit{30};
constexpr std::chrono::milliseconds kStopLook{50};

bool has_channel(const RunningDaemon& daemon, const std::string& name) {
  const std::vector<json::object> channels = objects_of(daemon.status, "channels");
  return std::ranges::any_of(channels,
                             [&](const json::object& each) { return text_of(each, "name") == name; });
}

bool is_running(const json::object& status, const std::string& name) {
  const std::vector<json::object> channels = objects_of(status, "channels");
  return std::ranges::any_of(channels, [&](const json::object& each) {
    return text_of(each, "name") == name && text_of(each, "state") != "ended";
  });
}

// "1234 (laser, scanner)".
std::string name_of(const RunningDaemon& daemon) {
  std::vector<std::string> channels;
  for (const json::object& channel : objects_of(daemon.status, "channels"))
    channels.push_back(text_of(channel, "name"));
  return fmt::format("{} ({})", daemon.client.pid(), fmt::join(channels, ", "));
}

struct Wanted {
  WantedDaemons daemons;
  std::string channel;
};

// The one that is meant.
Result<RunningDaemon> find_daemon(const Wanted& wanted) {
  RunningDaemons running = find_daemons(wanted.daemons);
  if (!wanted.channel.empty() && !wanted.daemons.pid)
    std::erase_if(running.daemons,
                  [&](const RunningDaemon& each) { return !has_channel(each, wanted.channel); });
  const auto silent = std::ranges::find(running.silent, Errc::io, &Error::code);
  if (!wanted.daemons.pid && silent != running.silent.end())
    return make_error(Errc::usage,
                      silent->message + " It could be the one that is meant; say which is with -p PID");
  if (running.daemons.size() == 1) return std::move(running.daemons.front());
  if (running.daemons.empty()) {
    if (!running.silent.empty()) return make_error(Errc::io, running.silent.front().message);
    return make_error(Errc::io,
                      wanted.daemons.pid || wanted.channel.empty()
                          ? no_daemon_text(wanted.daemons)
                          : fmt::format("no porttaped runs with a channel '{}'; porttape status has those "
                                        "that run",
                                        wanted.channel));
  }
  std::vector<std::string> names;
  for (const RunningDaemon& daemon : running.daemons) names.push_back(name_of(daemon));
  return make_error(Errc::usage, fmt::format("{} daemons could be meant; say which with -p PID: {}",
                                             names.size(), fmt::join(names, ", ")));
}

// Until the channel has ended, and with the last one the daemon.
bool wait_channel_ended(RunningDaemon& daemon, const std::string& channel) {
  const Instant limit = verb_clock().now() + kEndLimit;
  while (verb_clock().now() < limit) {
    const Result<json::object> reply = daemon.client.ask({{"verb", "status"}});
    if (!reply) {
      // It has closed its socket and ends, or it is slow.
      if (daemon.client.wait_ended(kStopLook)) return true;
      Result<std::optional<ControlClient>> again = ControlClient::connect(daemon.client.socket());
      if (again && *again) daemon.client = std::move(**again);
      continue;
    }
    if (!is_running(object_of(*reply, "status"), channel)) return true;
    std::this_thread::sleep_for(kStopLook);
  }
  return false;
}

struct Command {
  std::string verb;
  std::string text;  // behind it
};

// A verb, and what may stand behind it.
struct Word {
  std::string_view verb;
  std::string_view key = {};  // of the request; empty: nothing
  std::string_view what = {};
  bool needed = false;
  std::string_view example = {};
};

constexpr std::array kWords = {
    Word{"mark", "text", "text", true, "mark arm is moving"},
    Word{"pause"},
    Word{"resume"},
    Word{"step", "count", "number of exchanges", false, "step 3"},
    Word{"seek", "to", "time", true, "seek 12.5"},
    Word{"rate", "rate", "rate", true, "rate 0.5"},
    Word{"stop"},
};

const Word* word_of(std::string_view verb) {
  const auto* word = std::ranges::find(kWords, verb, &Word::verb);
  return word == kWords.end() ? nullptr : word;
}

Result<void> run_command(const Wanted& wanted, const Command& command, std::ostream& err) {
  Result<RunningDaemon> daemon = find_daemon(wanted);
  if (!daemon) return daemon.error();
  json::object request{{"verb", command.verb}};
  if (!wanted.channel.empty()) request["channel"] = wanted.channel;
  if (!command.text.empty()) request[word_of(command.verb)->key] = command.text;
  const Result<json::object> reply = daemon->client.ask(request);
  if (!reply) return reply.error();
  for (const json::object& refused : objects_of(*reply, "refused")) {
    err << "porttape ctl: note: " << printable_line(text_of(refused, "channel")) << ": "
        << printable_line(text_of(refused, "error")) << '\n';
  }
  if (command.verb != "stop") return {};
  const bool ended = wanted.channel.empty() ? daemon->client.wait_ended(kEndLimit)
                                            : wait_channel_ended(*daemon, wanted.channel);
  if (ended) return {};
  return make_error(Errc::io,
                    fmt::format("process {} has not ended after {} s; the same again ends it at once",
                                daemon->client.pid(), kEndLimit.count()));
}

// What is wrong, or nothing.
std::optional<std::string> take_words(const std::vector<std::string>& words, Command& command) {
  std::vector<std::string_view> known;
  for (const Word& word : kWords) known.push_back(word.verb);
  const std::string all = fmt::format("{}", fmt::join(known, ", "));
  if (words.empty()) return "no verb given; known: " + all;
  command.verb = words.front();
  const Word* const word = word_of(command.verb);
  if (word == nullptr) {
    const std::string near = did_you_mean(command.verb, known);
    return "unknown verb " + in_quotes(command.verb) + (near.empty() ? "; accepted: " + all : near);
  }
  for (std::size_t n = 1; n < words.size(); ++n) command.text += (n > 1 ? " " : "") + words[n];
  if (word->needed && command.text.empty())
    return fmt::format("{}: the {} is missing, as in: ctl {}", word->verb, word->what, word->example);
  if (word->key.empty() && words.size() > 1)
    return fmt::format("{} takes no more words; a channel is named with -c", word->verb);
  return std::nullopt;
}

}  // namespace

int run_ctl(Arguments args, std::ostream& out, std::ostream& err) {
  CommandLine line(kCtlHelp);
  line.takes_words().value("channel,c", "CHANNEL", "that channel alone");
  WantedDaemons::add_options(line);
  if (const auto done = line.parse(args, out, err)) return *done;
  Command command;
  if (const auto wrong = take_words(line.words(), command)) return line.usage_error(err, *wrong);
  const Result<WantedDaemons> daemons = WantedDaemons::of(line);
  if (!daemons) return line.usage_error(err, daemons.error().message);
  const Wanted wanted{*daemons, line.text("channel").value_or("")};
  const Result<void> ran = run_command(wanted, command, err);
  if (ran) return exit_status::kPass;
  err << "porttape ctl: " << printable_line(ran.error().message) << '\n';
  return exit_status_of(ran.error().code);
}

}  // namespace porttape
