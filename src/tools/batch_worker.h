#pragma once

#include <sys/types.h>

#include <string>

#include "tools/batch.h"
#include "tools/manifest.h"

namespace ktgp_orb {

/// The exit code of a worker whose disk was full.
constexpr int kExitFullDisk = 3;

/// A process that works on one recording, and ends with this one.
class BatchWorker {
 public:
  BatchWorker() = default;
  BatchWorker(const std::string& folder, const std::string& name, const std::string& input,
              const Origin& origin, const ProcessRecording& process);

  pid_t pid() const { return pid_; }
  /// What it said when it failed. `status`: of waitpid. To be called once.
  Outcome failure(int status) const;

 private:
  pid_t pid_ = -1;
  int messages_ = -1;  // what it wrote to its standard error
};

}  // namespace ktgp_orb
