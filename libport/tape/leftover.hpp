#pragma once

#include <cstddef>
#include <string>

namespace porttape {

// A hidden file or folder of our own that is to be gone when this object is, also where SIGINT, SIGTERM or
// SIGHUP ends the program meanwhile: a folder with the files in it. Only signals that nobody handles yet, and
// of the first kMost at one time. SIGKILL leaves it. Who makes a file and then its object does both while
// SignalsHeld.
class Leftover {
 public:
  static constexpr std::size_t kMost = 16;

  Leftover() = default;
  explicit Leftover(std::string path);
  // Makes a folder in `folder`, which is `its_path`, as make_private_folder() does; no signal comes between.
  // The path is empty, and errno says why, where that cannot be done.
  static Leftover make_folder(int folder, const std::string& its_path, const std::string& prefix);
  Leftover(Leftover&& other) noexcept;
  Leftover& operator=(Leftover&& other) noexcept;
  ~Leftover() { remove(); }

  [[nodiscard]] const std::string& path() const { return path_; }
  void remove();
  // It stays, or has another name by now.
  void keep();

 private:
  std::string path_;  // empty: nothing
  std::size_t slot_ = kMost;
};

}  // namespace porttape
