#pragma once

#include <set>
#include <string>
#include <sys/types.h>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/supervise/private_mounts.hpp"

namespace porttape {

// Folders of the system in which this process makes what others do not see: each becomes a file system in
// memory in which all that was there is there again (files and folders mounted, links copied). What cannot be
// mounted again is missing.
class PrivateFolders {
 public:
  explicit PrivateFolders(const PrivateMounts& mounts) : mounts_(mounts) {}

  // From now on the folder is such a one. It is made where it is missing, in one below the root that is
  // there.
  Result<void> own(const std::string& folder);

  // In folders that are, names that are replaced where they exist; a path's folder is made `own` first.
  Result<void> put_file(const std::string& path, const std::string& text);
  Result<void> put_link(const std::string& path, const std::string& target);
  // Takes away the links in a folder, if that is there, that lead to this name in whatever folder.
  Result<void> drop_links(const std::string& folder, const std::string& name);
  // The file `source` is mounted there.
  Result<void> put_mount(const std::string& path, const std::string& source);
  // A device of its own, usable if the system lets this process make such.
  Result<void> put_node(const std::string& path, mode_t mode, dev_t device);
  // Nothing else of what is there can be reached in that folder, which is mounted: files are /dev/null,
  // folders are empty. Links stay.
  Result<void> cover_all_but(const std::string& folder, const std::set<std::string>& names);
  // What cloned_folder() gave.
  Result<void> put_folder(const std::string& path, const UniqueFd& clone);
  // A folder with all that is mounted in it, as it is now.
  [[nodiscard]] Result<UniqueFd> cloned_folder(const std::string& folder) const;

 private:
  Result<void> copy(const std::string& folder);
  Result<void> free_name(const std::string& path);

  const PrivateMounts& mounts_;
  std::set<std::string> owned_;
};

}  // namespace porttape
