#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/line/line_signal.hpp"
#include "libport/port/port.hpp"

namespace porttape {

// The line of a driver that keeps its own device: two ports that pass nothing on, for a session that keeps a
// tape. What the driver and its device do is told here by one who sees it (TapCalls), and comes out of the
// port whose peer did it.
//
// Owned by whoever tells; each port may go at any time, and what is told then is lost. Loop thread only.
class TappedLine {
 public:
  // `device`: the path, if it is known before the driver opens it.
  explicit TappedLine(std::string device = {});
  ~TappedLine();
  TappedLine(const TappedLine&) = delete;
  TappedLine& operator=(const TappedLine&) = delete;

  // The session's ports, once each.
  std::unique_ptr<Port> driver_port();
  std::unique_ptr<Port> device_port();

  // The driver has opened its device, by this name; the last program has closed it.
  void opened(const std::string& device, const LineSettings& settings);
  void closed();
  [[nodiscard]] bool open() const { return open_; }
  // Of the device, as a port: `serial:/dev/ttyUSB0`. Empty before it was first opened.
  [[nodiscard]] std::string device_name() const { return name_.empty() ? "" : "serial:" + name_; }
  // Its path; empty before it was first opened.
  [[nodiscard]] const std::string& device_path() const { return name_; }
  // Bytes that the device's line has taken, and that the driver gets from it.
  void wrote(ByteView data);
  void got(ByteView data);
  // The driver has made the line so.
  void made(const LineSettings& settings);
  // It, or the device, has done something else to it, that is no request.
  void driver_did(const LineEvent& event);
  void device_did(const LineEvent& event);
  // The driver waits until all that it wrote has left; the returned function is called at the end of that.
  std::function<void()> drains();
  // The driver reads and writes where it is not seen: bytes are missing, nobody knows how many. Told once for
  // each time that the device is open; before it is opened, with that.
  void unseen(const std::string& why);
  [[nodiscard]] bool was_unseen() const { return was_unseen_; }
  // The device has gone while it was open.
  void lost(const std::string& why);
  [[nodiscard]] bool lost() const { return lost_; }

 private:
  class Driver;
  class Device;

  void note_unseen(const std::string& why);

  Driver* driver_ = nullptr;
  Device* device_ = nullptr;
  std::string device_path_;
  std::string name_;  // that it was opened by
  LineSettings settings_;
  bool open_ = false;
  bool lost_ = false;                // since it was opened
  std::vector<std::string> unseen_;  // why, since it was closed last
  bool was_unseen_ = false;          // ever
  RequestNumber drains_ = 0;         // of the driver, so far
};

}  // namespace porttape
