// Frames and matrices whose memory is reused when it is free: memory in use, also in other threads,
// never changes. Under ThreadSanitizer: no race between the holder's last read and the next use.

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <numeric>
#include <thread>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "moving_view.h"

namespace ktgp_orb {
namespace {

constexpr int kFrames = 60;

cv::Mat view(int i) {
  return test::viewAt(3 * (i % 60), 2 * (i % 60));
}

std::uint64_t sumOf(const cv::Mat& matrix) {
  std::uint64_t sum = 0;
  for (int row = 0; row < matrix.rows; ++row) {
    const std::uint8_t* bytes = matrix.ptr(row);
    sum = std::accumulate(bytes, bytes + matrix.cols, 31 * sum);
  }
  return sum;
}

std::uint64_t sumOf(const Features& features) {
  std::uint64_t sum = sumOf(features.descriptors);
  for (const cv::KeyPoint& keypoint : features.keypoints) sum = 31 * sum + keypoint.hash();
  for (const cv::Mat& image : features.images) sum = 31 * sum + sumOf(image);
  return sum;
}

std::uint64_t sumOf(const Frame& frame) {
  const std::uint64_t sum = 31 * sumOf(frame.features) + sumOf(frame.image);
  return 31 * sum + static_cast<std::uint64_t>(frame.stamp) + frame.encoding.size();
}

/// A thread that holds the last few frames that it received, then reads and releases them. Only the
/// atomic counts of the holders synchronise it with the sender, which is what is tested.
template <typename Held>
class Holder {
 public:
  explicit Holder(std::size_t most) : most_(most) {}
  ~Holder() { stop(); }

  void hold(const Held& held, std::uint64_t sum) {
    auto* next = new Task{held, sum};
    while (slot_.load(std::memory_order_relaxed) != nullptr) std::this_thread::yield();
    slot_.store(next, std::memory_order_release);
  }

  int stop() {
    if (thread_.joinable()) {
      stopping_ = true;
      thread_.join();
    }
    return changed_;
  }

 private:
  struct Task {
    Held held;
    std::uint64_t sum;
  };

  static std::uint64_t look(const FrameConstPtr& frame) { return sumOf(*frame); }
  static std::uint64_t look(const Features& features) { return sumOf(features); }

  // OpenCV decrements the count inside its library, where ThreadSanitizer does not see it. So the
  // same operation on the count, without a change, precedes it for the sanitizer.
  static void showRelease(const FrameConstPtr& /*frame*/) {}  // a std::shared_ptr, all in headers
  static void showRelease(const Features& features) {
    CV_XADD(&features.descriptors.u->refcount, 0);
    for (const cv::Mat& image : features.images) CV_XADD(&image.u->refcount, 0);
  }

  void run() {
    std::deque<std::unique_ptr<Task>> tasks;
    while (true) {
      const bool last = stopping_;
      Task* task = slot_.load(std::memory_order_acquire);
      if (task != nullptr) {
        tasks.emplace_back(task);
        if (tasks.size() > most_) letGo(tasks);
        slot_.store(nullptr, std::memory_order_relaxed);
      } else if (last) {
        while (!tasks.empty()) letGo(tasks);
        return;
      } else {
        std::this_thread::yield();
      }
    }
  }

  void letGo(std::deque<std::unique_ptr<Task>>& tasks) {
    const Task& oldest = *tasks.front();
    if (look(oldest.held) != oldest.sum) ++changed_;
    showRelease(oldest.held);
    tasks.pop_front();
  }

  const std::size_t most_;
  std::atomic<Task*> slot_{nullptr};
  std::atomic<bool> stopping_{false};
  int changed_ = 0;
  std::thread thread_{[this] { run(); }};
};

TEST(FrameReuse, ReleasedFrameIsReused) {
  SequenceOptions options;
  options.orb.max_features = 300;
  SequenceMatcher matcher(options);
  Holder<FrameConstPtr> holder(3);  // holds frames longer than the sequence
  for (int i = 0; i < kFrames; ++i) {
    const FrameConstPtr& frame = matcher.match(view(i), 0.1 * i).frame;
    holder.hold(frame, sumOf(*frame));
  }
  EXPECT_EQ(holder.stop(), 0) << "frames changed while another thread held them";
}

TEST(FrameReuse, MatricesAreUsedAgainOnceAnotherThreadHasLetThemGo) {
  for (ImageKeeping images : {ImageKeeping::copy, ImageKeeping::share}) {
    OrbOptions options;
    options.max_features = 300;
    options.images = images;
    OrbExtractor extractor(options);
    Holder<Features> holder(0);
    Features features;
    for (int i = 0; i < kFrames; ++i) {
      extractor.extract(view(i), features);
      holder.hold(features, sumOf(features));
    }
    EXPECT_EQ(holder.stop(), 0) << "matrices changed while another thread held them";
  }
}

/// A frame and what was in it.
struct Kept {
  explicit Kept(const FrameConstPtr& f)
      : frame(f), sum(sumOf(*f)), features(f->features.size()), orb(f->orb) {}

  void expectUnchanged() const {
    EXPECT_EQ(frame->features.size(), features);
    EXPECT_EQ(sumOf(*frame), sum);
    EXPECT_EQ(frame->orb, orb);
  }

  FrameConstPtr frame;
  std::uint64_t sum;
  std::size_t features;
  std::optional<OrbOptions> orb;
};

SequenceOptions fewFeatures(ReferenceMode mode, int features) {
  SequenceOptions options = test::sequenceOf(mode);
  options.orb.max_features = features;
  options.reference.min_inliers = 20;
  return options;
}

TEST(FrameReuse, NewOptionsDoNotChangeSharedFrames) {
  for (ReferenceMode mode :
       {ReferenceMode::previous, ReferenceMode::keyframe, ReferenceMode::fixed}) {
    SCOPED_TRACE(static_cast<int>(mode));
    SequenceMatcher matcher(fewFeatures(mode, 400));
    matcher.fixNextFrame();
    std::vector<Kept> kept;
    for (int i = 0; i < 3; ++i) {
      const SequenceMatch& match = matcher.match(view(i), 0.1 * i);
      kept.emplace_back(match.frame);
      if (match.reference) kept.emplace_back(match.reference);
    }
    const std::int64_t reference = kept.back().frame->stamp;
    const bool new_reference = mode == ReferenceMode::previous;
    matcher.setOptions(fewFeatures(mode, 200));
    const SequenceMatch& match = matcher.match(view(3), 0.3);
    EXPECT_EQ(match.match.status, Status::ok);
    EXPECT_EQ(match.no_reference, NoReference::none);
    ASSERT_TRUE(match.reference);
    EXPECT_LT(match.reference->features.size(), 300u) << "found with the new options";
    EXPECT_LT(match.frame->features.size(), 300u);
    EXPECT_EQ(match.reference->stamp, new_reference ? 200'000'000 : reference);
    EXPECT_EQ(match.reference_changed, new_reference) << "another frame, but the same image";
    for (const Kept& one : kept) one.expectUnchanged();
  }
}

TEST(FrameReuse, NewOptionsDoNotChangeAFrameGivenAgain) {
  SequenceMatcher matcher(fewFeatures(ReferenceMode::previous, 400));
  const FramePtr frame = test::frameOf(matcher, view(0));
  EXPECT_EQ(matcher.match(frame).frame, frame) << "its features are found in itself";
  const Kept kept(frame);
  matcher.setOptions(fewFeatures(ReferenceMode::previous, 200));
  EXPECT_LT(matcher.match(frame).frame->features.size(), 300u);
  matcher.setOptions(fewFeatures(ReferenceMode::fixed, 100));
  matcher.setFixedReference(frame);
  EXPECT_LT(matcher.fixedReference()->features.size(), 150u);
  kept.expectUnchanged();
}

// The mode does not need the features yet; a frame given without features stays without.
TEST(FrameReuse, FixedReferenceIsExtractedWhenNeeded) {
  SequenceMatcher matcher(fewFeatures(ReferenceMode::previous, 400));
  const FramePtr target = std::make_shared<Frame>();
  target->image = view(0);
  matcher.setFixedReference(target);
  const FrameConstPtr held = matcher.fixedReference();
  matcher.setOptions(fewFeatures(ReferenceMode::fixed, 400));
  EXPECT_EQ(matcher.match(view(1), 0.1).match.status, Status::ok);
  EXPECT_TRUE(held->features.empty());
}

// The caller's pixels are not reused before the last frame with them is released.
TEST(FrameReuse, NewFrameSharesPixelsOfTheOldOne) {
  SequenceMatcher matcher(fewFeatures(ReferenceMode::previous, 400));
  const cv::Mat pixels = view(0);
  std::weak_ptr<Frame> held;
  {
    const auto frame = std::make_shared<Frame>();
    frame->image = cv::Mat(pixels.size(), CV_8U, pixels.data);
    held = frame;
    matcher.match(frame);
  }
  matcher.setOptions(fewFeatures(ReferenceMode::previous, 200));
  matcher.match(view(1), 0.1);
  EXPECT_FALSE(held.expired()) << "the new frame of the same pixels is still the reference";
  matcher.match(view(2), 0.2);
  matcher.match(view(3), 0.3);
  EXPECT_TRUE(held.expired());
}

}  // namespace
}  // namespace ktgp_orb
