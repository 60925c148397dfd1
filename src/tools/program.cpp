#include "tools/program.h"

#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <system_error>

namespace ktgp_orb::tools {
namespace {

volatile std::sig_atomic_t signalled = 0;  // NOLINT: signal handlers can reach nothing else

int fail(const char* name, const char* message) {
  std::fprintf(stderr, "%s: %s\n", name, message);
  return kExitUnusable;
}

void handleSignals(void (*handler)(int)) {
  std::signal(SIGINT, handler);
  std::signal(SIGTERM, handler);
  // If SIGHUP was ignored before, nohup started this program: keep ignoring the signal.
  if (std::signal(SIGHUP, handler) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
}

int runAndReport(const char* name, const std::function<int()>& program) {
  try {
    return program();
  } catch (const std::bad_alloc&) {
    return fail(name, "out of memory; use fewer threads, jobs or features");
  } catch (const std::system_error& error) {
    if (error.code() != std::errc::resource_unavailable_try_again) return fail(name, error.what());
    return fail(name, "the system does not allow more threads; expected fewer of them");
  } catch (const std::exception& error) {
    return fail(name, error.what());
  }
}

}  // namespace

int runProgram(const char* name, const std::function<int()>& program) {
  // If the program that reads our output ends early ("| head"), do not end: complete the other
  // files.
  std::signal(SIGPIPE, SIG_IGN);
  // If a file exceeds the shell's size limit (ulimit -f), writing then fails with an error that we
  // can report, instead of ending the program.
  std::signal(SIGXFSZ, SIG_IGN);
  const int code = runAndReport(name, program);
  std::cout.flush();
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0 || !std::cout) {
    return fail(name, "the standard output cannot be written");
  }
  return code;
}

void stopWhenInterrupted() {
  handleSignals([](int /*signal*/) { signalled = 1; });
}

bool interrupted() {
  return signalled != 0;
}

void exitWhenInterrupted() {
  handleSignals([](int /*signal*/) { _exit(kExitInterrupted); });
}

ProgressBar::ProgressBar(std::size_t total) : total_(total), shown_(isatty(STDERR_FILENO) != 0) {}

ProgressBar::~ProgressBar() {
  say("");
}

void ProgressBar::say(const std::string& what) {
  if (shown_) std::fprintf(stderr, "\r\033[K%s", what.c_str());
}

void ProgressBar::advance(const std::string& what) {
  if (!shown_) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  ++done_;
  if (total_ == 0) {
    return say(std::to_string(done_) + " " + what);
  }
  constexpr std::size_t kWidth = 30;
  const std::size_t filled = kWidth * done_ / total_;
  const std::string bar = std::string(filled, '#') + std::string(kWidth - filled, '.');
  say("[" + bar + "] " + std::to_string(done_) + "/" + std::to_string(total_) + " " + what);
}

}  // namespace ktgp_orb::tools
