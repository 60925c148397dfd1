#pragma once

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "messages/configuration.h"

namespace ktgp_orb {

/// Does the work on images that does not depend on what became of the images before, several images
/// at a time: it finds the features and, unless the reference depends on earlier results (keyframe
/// mode), matches them. Images come out in the order in which they went in.
class FramePipeline {
 public:
  struct Prepared {
    FramePtr frame;
    std::optional<MatchAhead> ahead;
  };

  /// `fixed`: the reference of the fixed mode, null in the others. At least one thread. Throws
  /// std::system_error or std::bad_alloc where there are not enough threads or memory.
  FramePipeline(const Configuration& configuration, const FrameConstPtr& fixed, int threads);
  ~FramePipeline();

  void push(const sensor_msgs::ImageConstPtr& image);
  /// The oldest image. Waits for it; throws RefusedImage where it is of no use.
  Prepared pop();

  bool empty() const { return results_.empty(); }
  /// Enough is in the works to keep all threads busy.
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
  std::shared_future<FramePtr> last_frame_;  // null for a refused image
  std::deque<std::future<Prepared>> results_;

  std::mutex mutex_;  // guards tasks_ and closed_
  std::condition_variable changed_;
  std::deque<Task> tasks_;
  bool closed_ = false;
  std::vector<Worker> workers_;
  std::vector<std::thread> threads_;  ///< one for each worker
};

}  // namespace ktgp_orb
