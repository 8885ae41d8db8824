// `porttape bless`: the tape of a driver that was changed on purpose.

#include <algorithm>
#include <array>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <optional>
#include <ostream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_set.hpp"
#include "libport/tape/tape_writer.hpp"
#include "tools/command_verb.hpp"
#include "tools/option_description.hpp"
#include "tools/test_request.hpp"
#include "tools/test_verdict.hpp"
#include "tools/text.hpp"
#include "tools/verbs.hpp"
#include "tools/write_difference.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBlessAbout =
    "Runs COMMAND, a driver that was changed on purpose, against a tape of what it\n"
    "did before, shows what it writes differently, and makes a tape of that: the\n"
    "driver's new writes, and the recorded answers where they still apply. The old\n"
    "tape stays unless --overwrite is given.\n\n"
    "Exit status: 0 there is a new tape, or nothing has changed; 1 COMMAND failed,\n"
    "which is not blessed; 2 wrong use; 130 and 143 when interrupted.\n\n";

constexpr std::size_t kMostShown = 32;  // bytes of a write

// What of a test is no choice here: every write is taken, the line goes on, and the new tape, which may take
// the old one's place, is of all of it, as it was recorded.
bool is_no_choice(const OptionSpec& spec) {
  constexpr std::array<std::string_view, 18> names = {
      "strictness", "jitter",  "early-only", "on-mismatch", "check-settings", "report",
      "junit",      "session", "start",      "end",         "preroll",        "at-end",
      "loops",      "max-gap", "rate",       "chunks",      "faults",         "seed"};
  return std::ranges::find(names, spec.name) != names.end();
}

std::vector<OptionSpec> bless_options() {
  std::vector<OptionSpec> specs = test_options();
  std::erase_if(specs, is_no_choice);
  specs.push_back({.name = "output",
                   .help = "the new tape's name; by default the next free one, laser.2.log",
                   .value_name = "NAME"});
  specs.push_back({"overwrite", OptionSpec::Kind::flag, "", "the new tape takes the old one's place"});
  return specs;
}

std::string shown(const Bytes& bytes) {
  const ByteView view(bytes);
  const bool cut = view.size() > kMostShown;
  return '"' + to_printable(view.first(std::min(view.size(), kMostShown))) + (cut ? "\".." : "\"");
}

std::string bytes_of(const Bytes& bytes) { return counted(bytes.size(), "byte"); }

// One difference, and what cannot be known of it.
void tell(const WriteDifference& difference, const std::vector<WrittenExchange>& old_tape,
          const std::vector<WrittenExchange>& new_tape, std::ostream& out) {
  const WrittenExchange* const before =
      difference.old_number ? &old_tape.at(*difference.old_number - 1) : nullptr;
  const WrittenExchange* const now =
      difference.new_number ? &new_tape.at(*difference.new_number - 1) : nullptr;
  if (before != nullptr) fmt::print(out, "- exchange {}: {}\n", *difference.old_number, shown(before->write));
  if (now != nullptr) fmt::print(out, "+ exchange {}: {}\n", *difference.new_number, shown(now->write));
  if (now == nullptr) {
    fmt::print(out, "    no longer written; on the tape {} answered it\n", bytes_of(before->read));
  } else if (now->read.empty()) {
    fmt::print(out, "    no answer came: none is on the tape, and what the device says to it is not known\n");
  } else if (before != nullptr && before->read == now->read) {
    fmt::print(out, "    its recorded answer is kept ({}); whether the device still gives it is not known\n",
               bytes_of(now->read));
  } else {
    fmt::print(out,
               "    {} came, which the tape has for other writes: what the device says to it is not known\n",
               bytes_of(now->read));
  }
}

class Blessing {
 public:
  Blessing(CommandVerbLine line, std::ostream& out, std::ostream& err)
      : line_(std::move(line)), out_(out), err_(err) {}

  Result<int> run() {
    if (Result<void> ready = prepare(); !ready) return ready.error();
    const TestVerdict verdict = run_one_test(*request_);
    for (const std::string& note : verdict.notes)
      fmt::print(err_, "porttape bless: {}\n", printable_line(note));
    return judge(verdict);
  }

 private:
  Result<void> prepare() {
    const auto output = line_.values.extract("output");
    overwrites_ = !line_.values.extract("overwrite").empty();
    if (const auto group = line_.values.find("connections");
        group != line_.values.end() && group->second == "each")
      return make_error(
          Errc::usage,
          "connections 'each' plays several tapes, and one is blessed at a time: bless the tape "
          "of each connection by itself");
    if (output && overwrites_)
      return make_error(Errc::usage, "options 'output' and 'overwrite' do not go together; choose one");
    line_.values["strictness"] = "0";
    line_.values["on-mismatch"] = "warn";
    Result<TestRequest> request = read_test(std::move(line_.values), std::move(line_.command));
    if (!request) return request.error();
    old_ = request->replay().tape;
    const Result<TapePaths> named = output ? named_new_tape(output.mapped()) : Result<TapePaths>(old_);
    if (!named) return make_error(Errc::usage, "option 'output': " + named.error().message);
    target_ = overwrites_ || output ? *named : next_free();
    if (!overwrites_ && is_taken(target_)) {
      return make_error(Errc::usage,
                        fmt::format("there is a tape {} already, or another file under its name; give "
                                    "another --output",
                                    in_quotes(target_.name())));
    }
    Result<TapeSet> made = TapeSet::begin(target_, overwrites_ ? OnExisting::overwrite : OnExisting::refuse);
    if (!made) return made.error();
    Result<TapePaths> place = made->place(target_);
    if (!place) return place.error();
    made_.emplace(std::move(*made));
    request->record_to = std::move(*place);
    request_.emplace(std::move(*request));
    return {};
  }

  Result<int> judge(const TestVerdict& verdict) {
    if (verdict.error) return *verdict.error;
    const int status = verdict.exit_status();
    if (status > 128) return status;
    if (status != exit_status::kPass) {
      out_ << to_text(verdict.report) << std::flush;
      fmt::print(err_, "porttape bless: nothing is blessed: the command is to end well first\n");
      return exit_status::kRuntime;
    }
    for (const Doubt& doubt : verdict.report.doubts)
      fmt::print(err_, "porttape bless: doubt: {}\n", printable_line(doubt.text));
    if (std::ranges::find(verdict.report.doubts, Doubt::Kind::gap, &Doubt::kind) !=
        verdict.report.doubts.end()) {
      fmt::print(err_,
                 "porttape bless: nothing is blessed: {} is not whole, and a new tape would not show it; "
                 "record it anew\n",
                 printable_line(old_.name()));
      return exit_status::kRuntime;
    }
    const Result<std::vector<WrittenExchange>> before = read_exchanges(old_);
    if (!before) return before.error();
    const Result<std::vector<WrittenExchange>> now = read_exchanges(*request_->record_to);
    if (!now) return now.error();
    const std::vector<WriteDifference> differences = compare_writes(*before, *now);
    for (const WriteDifference& difference : differences) tell(difference, *before, *now, out_);
    if (differences.empty()) {
      fmt::print(out_, "the driver writes what {} has; nothing is to be blessed\n",
                 printable_line(old_.name()));
      return exit_status::kPass;
    }
    if (Result<void> placed = place(); !placed) return placed.error();
    fmt::print(out_, "{}: {} of {} in {} changed\n", printable_line(target_.name()), differences.size(),
               counted(std::max(before->size(), now->size()), "exchange"), printable_line(old_.name()));
    out_.flush();
    if (!overwrites_)
      fmt::print(err_, "porttape bless: {} is as it was; --overwrite puts the new tape in its place\n",
                 printable_line(old_.name()));
    return exit_status::kPass;
  }

  // A link that leads nowhere takes a name, too.
  static bool is_taken(const TapePaths& tape) {
    std::error_code ignored;
    return std::ranges::any_of(std::array{&tape.read, &tape.write, &tape.events}, [&](const fs::path* file) {
      return fs::exists(fs::symlink_status(*file, ignored));
    });
  }

  [[nodiscard]] TapePaths next_free() const {
    unsigned number = 2;
    while (is_taken(numbered_tape(old_, number))) ++number;
    return numbered_tape(old_, number);
  }

  Result<void> place() {
    // It is in a folder of ours until it is published.
    Result<void> published = keep_from_others(*request_->record_to, kept_from_others(old_));
    if (published) published = made_->publish();
    if (published) return published;
    Error error = published.error();
    error.message += "; nothing is blessed, and the new tape is gone";
    return error;
  }

  CommandVerbLine line_;
  std::ostream& out_;
  std::ostream& err_;
  std::optional<TestRequest> request_;
  TapePaths old_;
  TapePaths target_;
  bool overwrites_ = false;
  std::optional<TapeSet> made_;  // of the new tape alone; what is not published goes away with it
};

}  // namespace

int run_bless(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "bless",
                         .usage = "--tape NAME [options] -- COMMAND…",
                         .about = kBlessAbout,
                         .options = bless_options(),
                         .example = "--tape laser --overwrite -- ./laser_driver --device {port}"};
  return run_command_verb(verb, args, out, err, [&](CommandVerbLine line) -> Result<int> {
    return Blessing(std::move(line), out, err).run();
  });
}

}  // namespace porttape
