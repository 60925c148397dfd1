#pragma once

#include <unistd.h>

#include <atomic>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <thread>
#include <utility>

#include "robot_testing.h"

/// Common code of the tests that unload a nodelet during other work.
namespace ktgp_orb::test {

/// Calls a function repeatedly in its own thread.
class Churn {
 public:
  explicit Churn(std::function<void(int)> act)
      : thread_([this, act = std::move(act)] {
          for (int i = 0; running_; ++i) act(i);
        }) {}
  ~Churn() {
    running_ = false;
    thread_.join();
  }

 private:
  std::atomic<bool> running_{true};
  std::thread thread_;
};

/// A picture in its own file, which is removed with it.
class PictureFile {
 public:
  PictureFile(const std::string& name, const cv::Mat& pixels)
      : path_("/tmp/ktgp_orb_" + name + "_" + std::to_string(getpid()) + ".png") {
    cv::imwrite(path_, pixels, {cv::IMWRITE_PNG_COMPRESSION, 1});
  }
  ~PictureFile() { unlink(path_.c_str()); }
  PictureFile(const PictureFile&) = delete;
  PictureFile& operator=(const PictureFile&) = delete;

  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

inline void sleepMilliseconds(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

}  // namespace ktgp_orb::test
