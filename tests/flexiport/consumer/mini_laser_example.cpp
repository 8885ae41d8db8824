// `mini_laser_example PORTOPTIONS COMMAND...`: the same output whatever the port.

#include "mini_laser.h"
#include <cstdio>
#include <exception>

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  try {
    MiniLaser laser(argv[1]);
    for (int i = 2; i < argc; ++i) std::fputs(laser.Ask(argv[i]).c_str(), stdout);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mini_laser_example: %s\n", error.what());
    return 1;
  }
  return 0;
}
