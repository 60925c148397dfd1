#pragma once

#include <cxxabi.h>
#include <pybind11/pybind11.h>
#include <unistd.h>

#include <mutex>
#include <optional>
#include <stdexcept>

namespace ktgp_orb::python {

/// Lets other threads of Python run. A daemon thread that comes back after the end of the
/// interpreter stops here for ever, as it does in Python 3.14. Older ones end it by unwinding,
/// which would abort the process on its way through C++.
class WithoutGil {
 public:
  WithoutGil() = default;
  ~WithoutGil() {
    try {
      PyEval_RestoreThread(state_);
    } catch (const abi::__forced_unwind&) {
      for (;;) pause();
    }
  }
  WithoutGil(const WithoutGil&) = delete;
  WithoutGil& operator=(const WithoutGil&) = delete;

 private:
  PyThreadState* state_ = PyEval_SaveThread();
};

/// Of an object that several Python threads may use, one after the other.
class Shared {
 public:
  /// Waits until no other thread uses the object, and lets other threads of Python run. To be made
  /// and destroyed with the GIL, without which no process is forked.
  class Use {
   public:
    /// Throws std::runtime_error in a forked process if the object was in use at the fork: its
    /// user is not there, and would be waited for in vain.
    explicit Use(Shared& shared) : shared_(shared) {
      if (!shared_.mutex_.try_lock()) {
        if (shared_.process_ != getpid()) {
          throw std::runtime_error(
              "the object was in use by a thread when this process was forked; expected an object "
              "made after the fork");
        }
        const WithoutGil others_may_run;
        shared_.mutex_.lock();
      }
      shared_.process_ = getpid();
      others_may_run_.emplace();
    }
    ~Use() { shared_.mutex_.unlock(); }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    Shared& shared_;
    std::optional<WithoutGil> others_may_run_;
  };

 private:
  std::mutex mutex_;
  pid_t process_ = getpid();  // of its latest user
};

}  // namespace ktgp_orb::python
