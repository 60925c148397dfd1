#include "tools/bag_pipeline.h"

namespace ktgp_orb::tools {

FramePipeline::FramePipeline(const Configuration& configuration, const FrameConstPtr& fixed,
                             int threads)
    : options_(withImages(configuration.sequence)), fixed_(fixed) {
  for (int i = 0; i < threads; ++i) {
    workers_.push_back({OrbExtractor(options_.orb), KtgpMatcher(options_.matcher),
                        FrameMaker(configuration.stretch, configuration.view)});
  }
  try {
    for (Worker& worker : workers_) threads_.emplace_back([this, &worker] { work(worker); });
  } catch (...) {
    stop();
    throw;
  }
}

FramePipeline::~FramePipeline() {
  stop();
}

void FramePipeline::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void FramePipeline::push(const sensor_msgs::ImageConstPtr& image) {
  const auto found = std::make_shared<std::promise<FramePtr>>();
  std::shared_future<FramePtr> before = std::exchange(last_frame_, found->get_future().share());
  Task task([this, image, found, before](Worker& worker) {
    FramePtr frame;
    MatchAhead ahead;
    try {
      frame = std::make_shared<Frame>();
      worker.frame_maker.make(image, *frame);
      extractFeatures(worker.extractor, *frame);
    } catch (...) {
      found->set_value(nullptr);
      throw;
    }
    found->set_value(frame);
    FrameConstPtr reference = fixed_;
    // The threads start the tasks in the order of the frames. So the task of the previous frame is
    // already running, and waiting for it cannot cause a deadlock.
    const bool previous = options_.reference.mode == ReferenceMode::previous;
    if (previous && before.valid()) reference = before.get();
    if (reference && canMatchAhead(options_.matcher)) {
      ahead.reference = reference;
      worker.matcher.match(reference->features, frame->features, ahead.result);
    }
    return Prepared(frame, std::move(ahead));
  });
  results_.push_back(task.get_future());
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  changed_.notify_one();
}

FramePipeline::Prepared FramePipeline::pop() {
  std::future<Prepared> result = std::move(results_.front());
  results_.pop_front();
  return result.get();
}

void FramePipeline::work(Worker& worker) {
  while (true) {
    Task task;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [this] { return closed_ || !tasks_.empty(); });
      if (tasks_.empty()) return;
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    task(worker);
  }
}

}  // namespace ktgp_orb::tools
