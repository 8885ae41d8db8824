#include "tools/fault_run.hpp"

#include <utility>

#include <boost/json/parse.hpp>
#include <boost/json/serialize.hpp>
#include <boost/json/value.hpp>

#include "libport/faults/fault_port.hpp"
#include "libport/tape/tape_name.hpp"
#include "tools/private_folder.hpp"
#include "tools/test_request.hpp"
#include "tools/test_run.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

// A wrapper is there in any case, since it tells what passes.
constexpr const char* kNoFault = "drop:p=0";

class FaultRun {
 public:
  explicit FaultRun(const FaultRunJob& job) : job_(job) {}

  Result<FaultRunEnd> run(const FaultRunSetup& setup, const std::string& folder) {
    if (job_.tracks) {
      Result<TapeParts> tape = TapeParts::load(literal_tape(job_.tape));
      if (!tape) return tape.error();
      tape_ = std::move(*tape);
      tracker_.emplace(tape_->parts(), job_.exact);
    }
    Result<TestRequest> request = read_test(values_of(setup, folder), setup.command);
    if (!request) return request.error();
    FaultOptions faults = *request->ports.device.get<FaultOptions>();
    faults.on_passing = [this](LineDir dir, ByteView bytes) { track(dir, bytes); };
    faults.on_made = [this](const LineFault& fault) { note(fault); };
    request->ports.device.set(std::move(faults));
    TestRun test(std::move(*request));
    test_ = &test;
    const Result<RunReport> report = test.run();
    test_ = nullptr;
    if (!report) return report.error();
    end_.status = test.end().command.status;
    end_.signal = test.end().command.signal;
    end_.ended_because = test.end().ended_because;
    end_.verdict = to_string(report->verdict);
    end_.passed = report->verdict == Verdict::pass && !report->trouble;
    if (tracker_) take_track();
    return std::move(end_);
  }

 private:
  [[nodiscard]] std::map<std::string, std::string> values_of(const FaultRunSetup& setup,
                                                             const std::string& folder) const {
    std::map<std::string, std::string> values = setup.values;
    values["tape"] = job_.tape;
    values["driver"] = "pty:" + folder + "/port";
    values["faults"] = job_.faults.empty() ? kNoFault : job_.faults;
    values["seed"] = std::to_string(job_.seed);
    return values;
  }

  void track(LineDir dir, ByteView bytes) {
    end_.bytes += bytes.size();
    if (!tracker_) return;
    if (dir == LineDir::w) {
      tracker_->driver_wrote(bytes);
    } else {
      tracker_->driver_was_sent(bytes);
    }
    const bool far = job_.enough && tracker_->reach() >= *job_.enough;
    const bool unknown = job_.ends_at_unknown && !tracker_->unknown().empty();
    if (end_.enough || (!far && !unknown)) return;
    end_.enough = true;
    test_->kill();
  }

  void note(const LineFault& fault) {
    ++end_.faults_made;
    if (end_.faults.size() < FaultPlan::kMostFaults) end_.faults.push_back(fault.spec.raw());
  }

  void take_track() {
    end_.turns = tracker_->turns();
    end_.reach = tracker_->reach();
    end_.beyond = tracker_->beyond();
    end_.unknown_hex = to_hex(tracker_->unknown());
  }

  FaultRunJob job_;
  std::optional<TapeParts> tape_;
  std::optional<RequestTracker> tracker_;
  TestRun* test_ = nullptr;
  FaultRunEnd end_;
};

std::string text_at(const json::object& object, const char* key) {
  return object.at(key).as_string().c_str();
}
template <class Number>
Number number_at(const json::object& object, const char* key) {
  return object.at(key).to_number<Number>();
}

}  // namespace

Result<FaultRunEnd> do_fault_run(const FaultRunSetup& setup, const FaultRunJob& job) {
  PrivateFolder folder;
  const Result<std::string> path = folder.make();
  if (!path) return path.error();
  return FaultRun(job).run(setup, *path);
}

std::string to_text(const FaultRunJob& job) {
  json::object object{{"tape", job.tape},   {"faults", job.faults},
                      {"seed", job.seed},   {"tracks", job.tracks},
                      {"exact", job.exact}, {"ends_at_unknown", job.ends_at_unknown}};
  if (job.enough) object["enough"] = *job.enough;
  return json::serialize(object);
}

FaultRunJob fault_run_job(const std::string& text) {
  const json::value value = json::parse(text);
  const json::object& object = value.as_object();
  FaultRunJob job{.tape = text_at(object, "tape"),
                  .faults = text_at(object, "faults"),
                  .seed = number_at<std::uint64_t>(object, "seed"),
                  .tracks = object.at("tracks").as_bool(),
                  .exact = object.at("exact").as_bool(),
                  .ends_at_unknown = object.at("ends_at_unknown").as_bool()};
  if (object.contains("enough")) job.enough = number_at<std::size_t>(object, "enough");
  return job;
}

std::string to_text(const FaultRunEnd& end) {
  json::array turns;
  for (const auto& [part, read, written] : end.turns) turns.push_back(json::array{part, read, written});
  return json::serialize(json::object{{"status", end.status},
                                      {"signal", end.signal},
                                      {"because", end.ended_because},
                                      {"verdict", end.verdict},
                                      {"passed", end.passed},
                                      {"enough", end.enough},
                                      {"faults", json::array(end.faults.begin(), end.faults.end())},
                                      {"made", end.faults_made},
                                      {"bytes", end.bytes},
                                      {"turns", std::move(turns)},
                                      {"reach", end.reach},
                                      {"beyond", end.beyond},
                                      {"unknown", end.unknown_hex}});
}

FaultRunEnd fault_run_end(const std::string& text) {
  const json::value value = json::parse(text);
  const json::object& object = value.as_object();
  FaultRunEnd end{.status = number_at<int>(object, "status"),
                  .signal = number_at<int>(object, "signal"),
                  .ended_because = text_at(object, "because"),
                  .verdict = text_at(object, "verdict"),
                  .passed = object.at("passed").as_bool(),
                  .enough = object.at("enough").as_bool(),
                  .faults_made = number_at<std::uint64_t>(object, "made"),
                  .bytes = number_at<std::uint64_t>(object, "bytes"),
                  .reach = number_at<std::size_t>(object, "reach"),
                  .beyond = object.at("beyond").as_bool(),
                  .unknown_hex = text_at(object, "unknown")};
  for (const json::value& fault : object.at("faults").as_array()) end.faults.emplace_back(fault.as_string());
  for (const json::value& turn : object.at("turns").as_array()) {
    const json::array& numbers = turn.as_array();
    end.turns.push_back({numbers.at(0).to_number<std::size_t>(), numbers.at(1).to_number<std::uint64_t>(),
                         numbers.at(2).to_number<std::uint64_t>()});
  }
  return end;
}

}  // namespace porttape
