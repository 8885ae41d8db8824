#pragma once

#include <functional>
#include <memory>

#include "libport/port/port_options.hpp"
#include "libport/port/port_type.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"
#include "libport/taped/tape_group.hpp"

namespace porttape {

// `logreader` makes a ReplayedDevice, or a ReplayedDriver where the tape plays the driver; its typed options
// are ReplayOptions.
PortType logreader_type();

// A port with a tape of it.
struct RecordingOptions {
  PortSpec inner;
  TapePaths tape;
  OnExisting on_existing = OnExisting::refuse;
  bool fail_closed = false;
  std::function<void(const TapePaths&)> on_ended = {};  // each tape that was made, at its end
  std::function<std::string()> device_name = {};        // for the tape, if it is no more what was written
  // One of these, of this connection; null: a tape by itself.
  std::shared_ptr<TapeGroup> group = {};
  unsigned connection = 1;
};

// What such a type has besides the options of the port.
std::vector<OptionSpec> tape_options();

// The type that records ports of `inner`, which has a recorded_as; makes a TapPort with a TapeKeeper.
PortType recording_type(const PortType& inner);

// A replay with a tape of what passes in it. Refuses a tape that is there.
Result<PortSpec> recorded_replay(const PortSpec& replay, const TapePaths& tape);

// Where a tape is played decides some defaults; the others are the type's, which are flexiport's.
enum class ReplayUse { verb, test, drive, in_process, drop_in };
// The option's default there, or `general`.
std::string_view replay_default(ReplayUse use, std::string_view option, std::string_view general);
// What the option does there, for --help, or `general`.
std::string_view replay_help(ReplayUse use, std::string_view option, std::string_view general);
// Whether it, or this choice of it, is about the device that a tape plays, so that `drive` has no use for it.
bool is_of_device(std::string_view option, std::string_view choice = {});
// Puts the defaults where nothing was given.
void set_replay_defaults(ReplayUse use, std::map<std::string, std::string>& values);

}  // namespace porttape
