#pragma once

#include <string>

namespace porttape {

// What the rights of a device are to a user.
struct DeviceAccess {
  std::string device = {};
  std::string user = {};   // who wants to open it
  std::string owner = {};  // and whose it is
  std::string group = {};
  bool group_may = false;  // open it for what is wanted
  bool is_member = false;  // this process, of the group
  bool is_listed = false;  // the user, as a member for the next login
};

// Asks the system, whose lists of users and groups may be on another machine: it can wait. `mode` is that of
// access(): R_OK, W_OK.
DeviceAccess device_access(const std::string& device, int mode);

// What the user is to do about a device that cannot be opened for want of rights.
std::string access_advice(const DeviceAccess& access);

}  // namespace porttape
