#include "tools/batch_worker.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include "cli/files.h"
#include "cli/program.h"

namespace ktgp_orb {
namespace {

namespace fs = std::filesystem;

/// A folder for unfinished files that only one process has: the lock ends with the process.
class LockedFolder {
 public:
  explicit LockedFolder(const std::string& path) : path_(path) {
    fs::create_directories(path);
    folder_ = open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    struct stat opened {};
    struct stat named {};
    const bool locked = folder_ >= 0 && flock(folder_, LOCK_EX | LOCK_NB) == 0 &&
                        fstat(folder_, &opened) == 0 && stat(path.c_str(), &named) == 0 &&
                        opened.st_ino == named.st_ino;
    if (!locked) throw tools::FileError(path, "another process works on this recording");
    for (const auto& left : fs::directory_iterator(path)) fs::remove_all(left.path());
  }

  void remove() const {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  void renameTo(const std::string& target) const {
    if (fs::exists(target)) {
      if (!hasManifest(target)) {
        throw tools::FileError(target, "exists, and is not the result of a batch");
      }
      fs::remove_all(target);  // of other parameters, or of another input
    }
    fs::create_directories(fs::path(target).parent_path());
    fs::rename(path_, target);
  }

 private:
  std::string path_;
  int folder_ = -1;  // until the process ends
};

int work(const std::string& folder, const std::string& name, const std::string& input,
         const Origin& origin, const ProcessRecording& process) {
  const std::string unfinished = folder + "/.unfinished/" + name;
  const LockedFolder locked(unfinished);
  int code = tools::kExitUnusable;
  try {
    const Outcome outcome = process(input, unfinished);
    code = outcome.exit_code;
    if (code == tools::kExitDone || code == tools::kExitUnusedData) {
      writeManifest(unfinished, input, origin, outcome);
      locked.renameTo(folder + "/" + name);
      return code;
    }
  } catch (...) {
    locked.remove();
    throw;
  }
  locked.remove();
  return code;
}

int workOrFullDisk(const std::string& folder, const std::string& name, const std::string& input,
                   const Origin& origin, const ProcessRecording& process) {
  try {
    return work(folder, name, input, origin, process);
  } catch (const tools::FullDisk& error) {
    std::fprintf(stderr, "ktgp_bag: %s\n", error.what());
    return kExitFullDisk;
  } catch (const fs::filesystem_error& error) {
    std::fprintf(stderr, "ktgp_bag: %s\n", error.what());
    const bool full =
        error.code() == std::errc::no_space_on_device || error.code().value() == EDQUOT;
    return full ? kExitFullDisk : tools::kExitUnusable;
  }
}

/// The text after the last "ktgp_bag: ", in one line.
std::string reasonIn(int messages) {
  constexpr off_t kMost = 1 << 16;  // bytes
  const off_t size = lseek(messages, 0, SEEK_END);
  std::string text(static_cast<std::size_t>(std::clamp<off_t>(size, 0, kMost)), '\0');
  const ssize_t read = pread(messages, text.data(), text.size(), std::max<off_t>(0, size - kMost));
  text.resize(static_cast<std::size_t>(std::max<ssize_t>(0, read)));
  const std::string mark = "ktgp_bag: ";
  const std::size_t begin = text.rfind(mark);
  if (begin != std::string::npos) text.erase(0, begin + mark.size());
  text.erase(text.find_last_not_of(" \n\r") + 1);
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

BatchWorker::BatchWorker(const std::string& folder, const std::string& name,
                         const std::string& input, const Origin& origin,
                         const ProcessRecording& process)
    : messages_(memfd_create("messages", MFD_CLOEXEC)) {
  std::fflush(nullptr);
  const pid_t parent = getpid();
  pid_ = fork();
  if (pid_ < 0) throw std::system_error(errno, std::generic_category(), "fork");
  if (pid_ > 0) return;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(tools::kExitUnusable);
  const int nothing = open("/dev/null", O_WRONLY | O_CLOEXEC);
  dup2(nothing, STDOUT_FILENO);
  dup2(messages_ >= 0 ? messages_ : nothing, STDERR_FILENO);
  const int code = tools::runProgram(
      "ktgp_bag", [&] { return workOrFullDisk(folder, name, input, origin, process); });
  _exit(code);
}

Outcome BatchWorker::failure(int status) const {
  Outcome outcome;
  outcome.reason = reasonIn(messages_);
  close(messages_);
  if (WIFSIGNALED(status)) {
    outcome.exit_code = 128 + WTERMSIG(status);
    outcome.reason = "ended by signal " + std::to_string(WTERMSIG(status)) +
                     (outcome.reason.empty() ? "" : ": " + outcome.reason);
  } else {
    outcome.exit_code = WEXITSTATUS(status);
  }
  return outcome;
}

}  // namespace ktgp_orb
