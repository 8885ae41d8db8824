#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <sys/types.h>
#include <sys/un.h>
#include <vector>

#include "libport/base/result.hpp"

namespace porttape {

// The other users whose daemons root asks besides its own and those of the system's units. It is empty unless
// --user is given, because any user can make sockets that do not answer.
struct OtherUsers {
  bool all = false;
  std::optional<uid_t> one = {};

  // Reads `all`, a name or a number. Errc::usage: the system does not know the user.
  static Result<OtherUsers> parse(const std::string& text);
};

// What decides where control sockets lie.
struct ControlEnvironment {
  uid_t user = 0;
  std::string runtime_directory = {};  // $RUNTIME_DIRECTORY
  std::string xdg_runtime_dir = {};    // $XDG_RUNTIME_DIR
  std::string run = "/run";
  std::string tmp = "/tmp";

  static ControlEnvironment of_process();
};

// Where a daemon serves: FOLDER/PID.sock.
struct ControlFolder {
  std::string path;
  bool given = false;    // by whoever started the daemon: its permissions are theirs
  unsigned mode = 0700;  // of a folder that has to be made
};
ControlFolder control_folder(const ControlEnvironment& environment);

// The socket of a process.
std::string control_socket(std::string_view folder, pid_t pid);

// Where a client finds daemons: in the folder above if that is given; else in those of its user and of the
// system's units (each has a folder of its own). Besides, in those of other users that it asks for.
struct ControlSocket {
  std::string path;
  pid_t pid = 0;
  uid_t owner = 0;  // of its folder
};
std::vector<ControlSocket> control_sockets(const ControlEnvironment& environment,
                                           const OtherUsers& others = {});

// For bind() and connect(); none where the path is too long for a socket.
std::optional<sockaddr_un> socket_address(const std::string& path);

// Whether nobody has that socket any more: then, and only then, it may be removed.
bool is_stale_socket(const std::string& path);

}  // namespace porttape
