#include "cli/progress_bar.h"

#include <unistd.h>

#include <cstdio>

namespace ktgp_orb::tools {

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
