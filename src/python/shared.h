#pragma once

#include <cxxabi.h>
#include <pybind11/pybind11.h>
#include <unistd.h>

#include <mutex>
#include <stdexcept>

namespace ktgp_orb::python {

/// Releases the GIL so that other Python threads can run. If a daemon thread wants the GIL back
/// after the interpreter has ended, it sleeps here forever, as it does in Python 3.14. Older
/// versions of Python end such a thread by unwinding its stack, which would abort the process
/// because C++ frames are on that stack.
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

/// An object that several Python threads may use, but only one at a time.
template <typename Object>
class Shared {
 public:
  template <typename Options>
  explicit Shared(const Options& options) : object_(options) {}

  /// Waits until no other thread uses the object, calls `work` with the GIL released, and returns
  /// its result. The caller must hold the GIL. A Python thread forks only while it holds the GIL,
  /// so no other thread can then fork while we check whether the object is in use. Throws
  /// std::runtime_error in a forked process if the object was in use at the time of the fork: the
  /// thread that used it does not exist in the new process, so the wait would never end.
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
  pid_t process_ = getpid();  // id of the process that used the object last
  Object object_;
};

}  // namespace ktgp_orb::python
