#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "libport/base/unique_fd.hpp"
#include "libport/supervise/supervisor.hpp"
#include "libport/supervise/tapped_files.hpp"
#include "libport/supervise/tapped_line.hpp"

namespace porttape {

struct EventRequest;

// What a program asks of its own device beside bytes, done on a duplicate of its descriptor and told to a
// TappedLine: settings, modem lines, breaks, flushes, drains. What the device does with its lines is told
// when a program looks at them. Loop thread only; outlives the supervisor's kept calls.
class TapRequests {
 public:
  TapRequests(TappedLine& line, TappedFiles& files) : line_(&line), files_(&files) {}

  [[nodiscard]] static std::vector<std::uint32_t> requests();

  // Such a request to `file`, the device.
  CallPart::Decision decide(Supervisor& supervisor, const Call& call,
                            const std::shared_ptr<TappedFile>& file);

  // The device has just been opened: what its settings and lines are.
  [[nodiscard]] static LineSettings settings_of(int file);
  void tell_first_lines(int file);

 private:
  Outcome make_settings(const Call& call, const TappedFile& file, std::uint32_t request);
  Outcome make(const EventRequest& request, const Call& call, const TappedFile& file);
  Outcome set_break(const TappedFile& file, bool on);
  CallPart::Decision begin_break_when_sent(Supervisor& supervisor, const Call& call,
                                           const std::shared_ptr<TappedFile>& file);
  Outcome drive_lines(const Call& call, const TappedFile& file, std::uint32_t request);
  Outcome give_lines(const Call& call, const TappedFile& file);
  CallPart::Decision drain(Supervisor& supervisor, const Call& call, const std::shared_ptr<TappedFile>& file);
  CallPart::Decision send_break(Supervisor& supervisor, const Call& call,
                                const std::shared_ptr<TappedFile>& file, Nanos length);
  void begin_break(const std::weak_ptr<KeptCall>& kept, const std::shared_ptr<TappedFile>& file,
                   Nanos length);
  void finish(const std::weak_ptr<KeptCall>& kept, TappedFile& file, Outcome outcome);
  void tell_signals(int bits, bool all);

  TappedLine* line_;
  TappedFiles* files_;
  int bits_ = 0;  // modem lines at the last look
};

}  // namespace porttape
