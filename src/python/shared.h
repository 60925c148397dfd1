#pragma once

#include <cxxabi.h>
#include <pybind11/pybind11.h>
#include <unistd.h>

#include <mutex>
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

/// An object that several Python threads may use, one after the other.
template <typename Object>
class Shared {
 public:
  template <typename Options>
  explicit Shared(const Options& options) : object_(options) {}

  /// Waits until no other thread uses the object, and lets other threads of Python run while it
  /// does the work; returns what that returns. To be called with the GIL, without which no process
  /// is forked. Throws std::runtime_error in a forked process if the object was in use at the fork:
  /// the thread that used it does not exist there, so the wait would not end.
  template <typename Work>
  auto use(const Work& work) {
    lock();
    const WithoutGil others_may_run;
    const std::lock_guard<std::mutex> locked(mutex_, std::adopt_lock);
    return work(object_);
  }

 private:
  void lock() {
    if (!mutex_.try_lock()) {
      if (process_ != getpid()) {
        throw std::runtime_error(
            "the object was in use by a thread when this process was forked; expected an object "
            "made after the fork");
      }
      const WithoutGil others_may_run;
      mutex_.lock();
    }
    process_ = getpid();
  }

  std::mutex mutex_;
  pid_t process_ = getpid();  // process of the latest user
  Object object_;
};

}  // namespace ktgp_orb::python
