#include <exception>
#include <iostream>
#include <string>
#include <unistd.h>
#include <vector>

#include "libport/base/error.hpp"
#include "tools/output.hpp"
#include "tools/verbs.hpp"

int main(int argc, char** argv) {
  using namespace porttape;
  try {
    const std::vector<std::string> args(argv + (argc > 0 ? 1 : 0), argv + argc);
    FdStreambuf buffer(STDOUT_FILENO);
    std::ostream out(&buffer);
    return finish_output(out, run_porttape(args, out, std::cerr), std::cerr);
  } catch (const std::exception& failure) {
    std::cerr << "porttape: " << failure.what() << '\n';
    return exit_status::kRuntime;
  }
}
