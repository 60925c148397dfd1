#include "cli/progress_bar.h"

#include <unistd.h>

#include <cstdio>

namespace ktgp_orb::tools {

ProgressBar::ProgressBar(std::size_t total) : total_(total), shown_(isatty(STDERR_FILENO) != 0) {}

ProgressBar::~ProgressBar() {
  if (shown_) std::fputs("\r\033[K", stderr);
}

void ProgressBar::advance(const std::string& what) {
  if (!shown_) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  ++done_;
  if (total_ == 0) {
    std::fprintf(stderr, "\r\033[K%zu %s", done_, what.c_str());
    return;
  }
  constexpr std::size_t kWidth = 30;
  const std::size_t filled = kWidth * done_ / total_;
  const std::string bar = std::string(filled, '#') + std::string(kWidth - filled, '.');
  std::fprintf(stderr, "\r\033[K[%s] %zu/%zu %s", bar.c_str(), done_, total_, what.c_str());
}

}  // namespace ktgp_orb::tools
