// When preloaded into a program (LD_PRELOAD), makes the system fail in ways that are hard to
// arrange:
//   KTGP_ORB_FAIL_WRITE=K   the K-th write to a regular file fails: the disk is full, for a moment
//   KTGP_ORB_FAIL_MARK=FILE which is then made
//   KTGP_ORB_KILL_WRITE=K   the K-th write to a regular file kills the program
//   KTGP_ORB_COUNT=FILE     which is given the number of these writes at the end
//   KTGP_ORB_KILL_AT=K      the K-th call that gives a file a name, or takes one after that, kills
//                           the program
//   KTGP_ORB_RENAME_AFTER=S a file gets a new name only after S seconds
//   KTGP_ORB_CLOCK=FILE     the wall clock is ahead by the seconds that the file holds (a double)
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>

namespace {

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

/// The value of a variable; 0: there is none.
long numberIn(const char* variable) {
  const char* text = std::getenv(variable);
  return text == nullptr ? 0 : std::atol(text);
}

/// Writes to regular files.
struct Writes {
  std::atomic<long> count{0};
  long kill_at = numberIn("KTGP_ORB_KILL_WRITE");
  long fail_at = numberIn("KTGP_ORB_FAIL_WRITE");

  ~Writes() {
    const char* name = std::getenv("KTGP_ORB_COUNT");
    if (name != nullptr) dprintf(creat(name, 0600), "%ld", count.load());
  }
};

bool mustFail(int descriptor) {
  static Writes writes;
  struct stat file {};
  if (fstat(descriptor, &file) != 0 || !S_ISREG(file.st_mode)) return false;
  const long number = ++writes.count;
  if (number == writes.kill_at) kill(getpid(), SIGKILL);
  if (number != writes.fail_at) return false;
  if (const char* mark = std::getenv("KTGP_ORB_FAIL_MARK")) close(creat(mark, 0600));
  errno = ENOSPC;
  return true;
}

std::atomic<bool> has_named{false};  // before it, names are only tried

void mayKill() {
  static std::atomic<long> left{numberIn("KTGP_ORB_KILL_AT")};
  if (--left == 0) kill(getpid(), SIGKILL);
}

/// Offset of the wall clock, s.
double ahead() {
  static const double* const value = [] {
    const char* file = std::getenv("KTGP_ORB_CLOCK");
    const int descriptor = file == nullptr ? -1 : open(file, O_RDONLY);
    void* page = mmap(nullptr, sizeof(double), PROT_READ, MAP_SHARED, descriptor, 0);
    return page == MAP_FAILED ? nullptr : static_cast<const double*>(page);
  }();
  return value == nullptr ? 0.0 : *static_cast<const volatile double*>(value);
}

}  // namespace

extern "C" {

ssize_t write(int descriptor, const void* bytes, size_t size) {
  static const auto real = next<ssize_t(int, const void*, size_t)>("write");
  return mustFail(descriptor) ? -1 : real(descriptor, bytes, size);
}

ssize_t writev(int descriptor, const iovec* parts, int count) {
  static const auto real = next<ssize_t(int, const iovec*, int)>("writev");
  return mustFail(descriptor) ? -1 : real(descriptor, parts, count);
}

size_t fwrite(const void* bytes, size_t size, size_t count, FILE* file) {
  static const auto real = next<size_t(const void*, size_t, size_t, FILE*)>("fwrite");
  return mustFail(fileno(file)) ? 0 : real(bytes, size, count, file);
}

int link(const char* from, const char* to) noexcept {
  static const auto real = next<int(const char*, const char*)>("link");
  has_named = true;
  mayKill();
  return real(from, to);
}

int rename(const char* from, const char* to) noexcept {
  static const auto real = next<int(const char*, const char*)>("rename");
  sleep(static_cast<unsigned>(numberIn("KTGP_ORB_RENAME_AFTER")));
  has_named = true;
  mayKill();
  return real(from, to);
}

int unlink(const char* name) noexcept {
  static const auto real = next<int(const char*)>("unlink");
  if (has_named) mayKill();
  return real(name);
}

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  static const auto real = next<int(clockid_t, timespec*)>("clock_gettime");
  const int code = real(clock, time);
  if (clock == CLOCK_REALTIME) time->tv_sec += static_cast<time_t>(std::lround(ahead()));
  return code;
}

int gettimeofday(timeval* time, void* zone) noexcept {
  static const auto real = next<int(timeval*, void*)>("gettimeofday");
  const int code = real(time, zone);
  time->tv_sec += static_cast<time_t>(std::lround(ahead()));
  return code;
}

}  // extern "C"
