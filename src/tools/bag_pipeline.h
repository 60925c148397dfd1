#pragma once

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "ros/configuration.h"

namespace ktgp_orb::tools {

/// Extracts the features of several images in parallel and, if possible, matches these images, too.
/// In keyframe mode, an image cannot be matched here, because its reference depends on the results
/// of earlier images. Returns the images in their original order.
class FramePipeline {
 public:
  /// A frame with features, and the result of its match in the pipeline. MatchAhead::reference is
  /// null if the frame could not be matched there.
  using Prepared = std::pair<FramePtr, MatchAhead>;

  /// `fixed`: the reference of the fixed mode; null in other modes. Starts `threads` threads, but
  /// at least one. Throws std::system_error or std::bad_alloc if threads or memory run out.
  FramePipeline(const Configuration& configuration, const FrameConstPtr& fixed, int threads);
  ~FramePipeline();

  void push(const sensor_msgs::ImageConstPtr& image);
  /// Waits until the oldest image is processed and returns it. Throws RefusedImage if the image is
  /// unusable.
  Prepared pop();

  /// Returns true if enough images are in progress to keep all threads busy.
  bool full() const { return results_.size() >= 2 * threads_.size(); }

 private:
  struct Worker {
    OrbExtractor extractor;
    KtgpMatcher matcher;
    FrameMaker frame_maker;
  };
  using Task = std::packaged_task<Prepared(Worker&)>;

  void work(Worker& worker);
  void stop();

  const SequenceOptions options_;
  const FrameConstPtr fixed_;
  std::shared_future<FramePtr> last_frame_;  // frame of the newest image; null if it was refused
  std::deque<std::future<Prepared>> results_;

  std::mutex mutex_;  // guards tasks_ and closed_
  std::condition_variable changed_;
  std::deque<Task> tasks_;
  bool closed_ = false;
  std::vector<Worker> workers_;
  std::vector<std::thread> threads_;  ///< each thread runs work() with its own Worker
};

}  // namespace ktgp_orb::tools
