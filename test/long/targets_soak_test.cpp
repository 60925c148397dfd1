// A long run of the targets' nodelet: frames as fast as it answers, while targets are added,
// replaced and removed. Nothing may grow, and no target may appear that is not there. Run by
// ctest -L long.

#include <ktgp_orb/DetectTargets.h>
#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/RemoveTarget.h>
#include <ktgp_orb/SetTarget.h>
#include <ktgp_orb/TargetDetections.h>
#include <visualization_msgs/MarkerArray.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <string>
#include <vector>

#include "files/target_list.h"
#include "resources.h"
#include "robot_testing.h"
#include "target_world.h"

namespace ktgp_orb {
namespace {

constexpr int kPictures = 80;
const cv::Size kPictureSize(300, 220);

cv::Mat pictureOf(int number) {
  return test::drawnPicture(kPictureSize, static_cast<std::uint64_t>(number));
}

struct TargetScene {
  cv::Mat image;
  std::vector<test::Shown> shown;
};

/// One or two pictures on a background, each at least 120 px wide; in every eighth scene one of
/// them twice.
TargetScene sceneOf(int number, const cv::Size& size) {
  cv::RNG random(static_cast<std::uint64_t>(number) + 1);
  TargetScene scene;
  const int first = random.uniform(0, kPictures);
  const int second = number % 8 == 0 ? first : (first + 1 + number % 7) % kPictures;
  for (int i = 0; i < 2; ++i) {
    test::Placement place;
    place.tilt = random.uniform(0.0, 0.5);
    place.axis = random.uniform(0.0, 6.28);
    place.turn = random.uniform(-0.4, 0.4);
    place.zoom = random.uniform(0.42, 0.5);
    place.middle = {size.width * (i == 0 ? 0.26 : 0.74), size.height * random.uniform(0.4, 0.6)};
    scene.shown.push_back({i == 0 ? first : second, test::homographyOf(place, kPictureSize)});
  }
  scene.image =
      test::frameOf(scene.shown, kPictureSize, size, 5000U + static_cast<unsigned>(number));
  return scene;
}

/// Which targets are known, with the numbers of their pictures. No picture belongs to two.
class Known {
 public:
  Known() {
    for (int i = 0; i < kPictures; ++i) free_.insert(i);
  }

  std::size_t size() const { return targets_.size(); }
  const std::map<std::string, std::vector<int>>& targets() const { return targets_; }
  bool has(const std::string& id) const { return targets_.count(id) > 0; }
  bool shows(const std::string& id, int picture) const {
    const auto it = targets_.find(id);
    return it != targets_.end() &&
           std::find(it->second.begin(), it->second.end(), picture) != it->second.end();
  }
  bool isFree(int picture) const { return free_.count(picture) > 0; }
  std::string drawId(cv::RNG& random) const {
    return std::next(targets_.begin(), random.uniform(0, static_cast<int>(size())))->first;
  }
  int drawFree(cv::RNG& random) const {
    return *std::next(free_.begin(), random.uniform(0, static_cast<int>(free_.size())));
  }

  void set(const std::string& id, const std::vector<int>& pictures) {
    remove(id);
    targets_[id] = pictures;
    for (const int picture : pictures) free_.erase(picture);
  }
  void remove(const std::string& id) {
    const auto it = targets_.find(id);
    if (it == targets_.end()) return;
    free_.insert(it->second.begin(), it->second.end());
    targets_.erase(it);
  }

 private:
  std::map<std::string, std::vector<int>> targets_;
  std::set<int> free_;
};

namespace fs = std::filesystem;
using test::Held;

constexpr int kCycle = 1000;                     // frames; then all targets are removed
constexpr int kStay = 5;                         // cycles per loading of the nodelet
constexpr std::size_t kFewest = 10, kMost = 30;  // targets
constexpr int kScenes = 60;                      // scenes of each size
// MB of growth, without targets. What is in use then varies by a few tenths. Half of the run has
// some 2000 changes, so 0.3 kB lost with each one are found.
constexpr double kHeapLimit = 0.5;
constexpr double kGrowthLimit = 4.0;  // MB of growth of the process
constexpr double kLeastFound = 0.97;  // share of the known targets in view
constexpr double kMaxError = 5.0;     // px; a farther one is not the one that is shown

const std::string kTargets = "/camera/targets/";
const cv::Size kSizes[] = {{320, 240}, {400, 300}, {352, 256}};

struct Tally {
  long shown = 0, found = 0, wrong = 0, poses = 0;
  int added = 0, replaced = 0, removed = 0, refused = 0, alone = 0, viewers = 0, pauses = 0,
      sizes = 0, loads = 0;
};

class Soak {
 public:
  Soak() {
    char name[] = "/tmp/targets_soak_XXXXXX";
    folder_ = mkdtemp(name);
    for (const cv::Size& size : kSizes) {
      for (int i = 0; i < kScenes; ++i) {
        scenes_.push_back(sceneOf(static_cast<int>(scenes_.size()), size));
      }
    }
    ros::param::set(kTargets + "file", file());
    ros::param::set(kTargets + "search_ms", 1000.0);  // whatever is known is searched
  }
  ~Soak() { fs::remove_all(folder_); }

  bool run() {
    nodelet::Loader loader(false);
    auto since = std::chrono::steady_clock::now();
    std::printf("%8s %6s %8s %8s %6s %8s %8s %8s %8s %8s\n", "frames", "Hz", "MB", "heap MB",
                "files", "threads", "found", "p50 ms", "p99 ms", "max ms");
    for (int done = 0; done < frames_; done += kCycle) {
      const int round = done / kCycle;
      if (round % kStay == 0 && !load(loader)) return false;
      if (!cycle(done)) return false;
      // In the middle of its stay, the nodelet must come back with the targets that it kept.
      if (round % kStay == kStay / 2 && (!unload(loader) || !load(loader) || !readAgain()))
        return false;
      if (!removeAll()) return false;
      const Held& held = course_.add(done + kCycle >= frames_ / 4);
      const auto now = std::chrono::steady_clock::now();
      report(done + kCycle, held, std::chrono::duration<double>(now - since).count());
      since = now;
      if ((round + 1) % kStay == 0 && !unload(loader)) return false;
    }
    judge();
    return true;
  }

 private:
  std::string file() const { return folder_ + "/kept.yaml"; }

  void judge() const {
    const double share = static_cast<double>(tally_.found) / static_cast<double>(tally_.shown);
    std::printf(
        "%d targets added, %d replaced, %d removed, %d requests refused, %d searches in images of "
        "requests, %d viewers, %d times no subscriber, %d changes of size, %d loads\n"
        "%ld of %ld targets in view found (%.2f %%), %ld wrong ones, %ld poses\n",
        tally_.added, tally_.replaced, tally_.removed, tally_.refused, tally_.alone, tally_.viewers,
        tally_.pauses, tally_.sizes, tally_.loads, tally_.found, tally_.shown, 100.0 * share,
        tally_.wrong, tally_.poses);
    course_.judge(kHeapLimit, kGrowthLimit);
    EXPECT_EQ(tally_.wrong, 0);
    EXPECT_GT(share, kLeastFound);
    EXPECT_GT(tally_.poses, tally_.found / 10);
    EXPECT_GT(tally_.shown, frames_ / 4);
  }

  bool load(nodelet::Loader& loader) {
    ++tally_.loads;
    return loader.load("/camera/targets", "ktgp_orb/Targets",
                       {{"/camera/image", "/camera/image_raw"}}, {}) &&
           feeder_.connect();
  }

  bool unload(nodelet::Loader& loader) { return loader.unload("/camera/targets"); }

  /// Shows the scene and waits for the answer; null after a while.
  TargetDetectionsConstPtr show(const TargetScene& scene) {
    return feeder_.show(test::imageMessage(scene.image, test::stampOf(number_++)));
  }

  const TargetScene& scene(int i) const {
    const int size = i / 250 % 3;
    return scenes_[static_cast<std::size_t>(size * kScenes + i / 3 % kScenes)];
  }

  bool cycle(int first) {
    std::unique_ptr<test::Recorder<sensor_msgs::Image>> overlay;
    std::unique_ptr<test::Recorder<visualization_msgs::MarkerArray>> markers;
    for (int i = 0; i < kCycle; ++i) {
      if (i % 4 == 0 && !change()) return false;
      if (i % 20 == 10 && !refused(i / 20)) return false;
      if (i % 100 == 30) {
        overlay = std::make_unique<test::Recorder<sensor_msgs::Image>>(kTargets + "image");
        markers =
            std::make_unique<test::Recorder<visualization_msgs::MarkerArray>>(kTargets + "markers");
        ++tally_.viewers;
      }
      if (overlay) {
        overlay->messages();
        overlay->clear();
        markers->messages();
        markers->clear();
      }
      if (i % 100 == 45) {
        overlay.reset();
        markers.reset();
      }
      if (i % 100 == 60 && !detectAlone(scene(7 * i))) return false;
      if (i % 250 == 0) calibrate(scene(i).image.size());
      if (i % 500 == 300 && !pause()) return false;
      const TargetDetectionsConstPtr answer = show(scene(i));
      if (!answer) {
        ADD_FAILURE() << "no answer to frame " << first + i;
        return false;
      }
      if (!check(scene(i), *answer)) return false;
    }
    return isKept();
  }

  /// Counts what was found and what was not; false if what is known is not what was set.
  bool check(const TargetScene& scene, const TargetDetections& message) {
    EXPECT_EQ(message.known, known_.size());
    std::vector<int> found(scene.shown.size(), 0);
    for (const TargetDetection& detection : message.detections) {
      tally_.poses += detection.has_pose;
      const int which = find(scene, detection);
      if (which >= 0) found[static_cast<std::size_t>(which)] = 1;
      if (which >= 0 || detection.status != MatchStatus::STATUS_OK) continue;
      ++tally_.wrong;
      std::printf("frame %d: %s is not there%s\n", number_, detection.id.c_str(),
                  known_.has(detection.id) ? "" : ", and not known");
    }
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (known_.isFree(scene.shown[i].number)) continue;
      ++tally_.shown;
      tally_.found += found[i];
    }
    return message.known == known_.size();
  }

  /// The number of the shown picture that it is; -1: none.
  int find(const TargetScene& scene, const TargetDetection& detection) const {
    const Eigen::Matrix3d homography =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(detection.homography.data());
    for (std::size_t i = 0; i < scene.shown.size(); ++i) {
      const test::Shown& shown = scene.shown[i];
      if (known_.shows(detection.id, shown.number) &&
          test::errorInView(shown.homography, homography, kPictureSize, scene.image.size()) <
              kMaxError) {
        return static_cast<int>(i);
      }
    }
    return -1;
  }

  /// Adds, replaces or removes a target.
  bool change() {
    const int kind = random_.uniform(0, 3);
    if (known_.size() < kFewest || (kind == 0 && known_.size() < kMost)) {
      ++tally_.added;
      return set("add", "target" + std::to_string(tally_.added));
    }
    const std::string id = known_.drawId(random_);
    if (kind == 1 || known_.size() >= kMost) return remove(id);
    ++tally_.replaced;
    return set("replace", id);
  }

  /// One or two images, some with a width and a frame.
  bool set(const std::string& service, const std::string& id) {
    std::vector<int> pictures{known_.drawFree(random_)};
    const int second = known_.drawFree(random_);
    if (random_.uniform(0, 5) == 0 && second != pictures[0]) pictures.push_back(second);
    SetTarget call;
    call.request.id = id;
    for (const int picture : pictures) {
      call.request.images.push_back(*test::imageMessage(pictureOf(picture), ros::Time(1)));
    }
    if (random_.uniform(0, 2) == 0) {
      call.request.width = 0.3;
      call.request.frame = id;
    }
    if (!ros::service::call(kTargets + service, call)) return false;
    EXPECT_TRUE(call.response.success) << call.response.message;
    known_.set(id, pictures);
    return call.response.success != 0;
  }

  bool remove(const std::string& id) {
    ++tally_.removed;
    RemoveTarget call;
    call.request.id = id;
    if (!ros::service::call(kTargets + "remove", call)) return false;
    EXPECT_TRUE(call.response.success) << call.response.message;
    known_.remove(id);
    return call.response.success != 0;
  }

  /// A request that must be refused.
  bool refused(int kind) {
    ++tally_.refused;
    SetTarget call;
    call.request.id = "bad";
    call.request.images = {*test::imageMessage(pictureOf(known_.drawFree(random_)), ros::Time(1))};
    std::string service = "add", words;
    switch (kind % 7) {
      case 0:
        call.request.images[0].data.resize(100);
        words = "100 bytes";
        break;
      case 1:
        call.request.id = known_.drawId(random_);
        words = "exists already";
        break;
      case 2:
        call.request.images = {
            *test::imageMessage(cv::Mat(kPictureSize, CV_8U, cv::Scalar(90)), ros::Time(1))};
        words = "too little texture";
        break;
      case 3:
        call.request.images = {*test::imageMessage(
            pictureOf(known_.targets().at(known_.drawId(random_)).front()), ros::Time(1))};
        words = "shows the same as";
        break;
      case 4:
        service = "replace";
        words = "does not exist";
        break;
      case 5:
        call.request.images.clear();
        words = "no image";
        break;
      default:
        return removeUnknown();
    }
    if (!ros::service::call(kTargets + service, call)) return false;
    EXPECT_FALSE(call.response.success) << words;
    EXPECT_NE(call.response.message.find(words), std::string::npos) << call.response.message;
    return call.response.success == 0;
  }

  bool removeUnknown() {
    RemoveTarget call;
    call.request.id = "bad";
    if (!ros::service::call(kTargets + "remove", call)) return false;
    EXPECT_FALSE(call.response.success);
    return call.response.success == 0;
  }

  bool detectAlone(const TargetScene& scene) {
    ++tally_.alone;
    DetectTargets call;
    call.request.image = *test::imageMessage(scene.image, ros::Time(1));
    if (!ros::service::call(kTargets + "detect", call)) return false;
    EXPECT_TRUE(call.response.success) << call.response.message;
    return check(scene, call.response.detections);
  }

  void calibrate(const cv::Size& size) {
    ++tally_.sizes;
    if (!infos_) infos_ = node_.advertise<sensor_msgs::CameraInfo>("/camera/camera_info", 1, true);
    infos_.publish(test::calibration(size, 600.0));
  }

  static bool sendTf(bool on) {
    return test::Change().set("publish_tf", on).send("/camera/targets");
  }

  /// Leaves the nodelet without a subscriber until it stops listening, then comes back.
  bool pause() {
    ++tally_.pauses;
    return sendTf(false) && feeder_.disconnect() && feeder_.connect() && sendTf(true);
  }

  /// Whether the list and its folder have exactly what is known.
  bool isKept() const {
    std::map<std::string, std::vector<int>> kept;
    std::size_t files = 0;
    for (const TargetEntry& entry : readTargetList(file())) {
      const std::vector<int>& pictures = known_.targets().at(entry.id);
      EXPECT_EQ(entry.files.size(), pictures.size());
      for (std::size_t i = 0; i < std::min(entry.files.size(), pictures.size()); ++i) {
        const cv::Mat image = cv::imread(entry.files[i], cv::IMREAD_UNCHANGED);
        EXPECT_EQ(cv::norm(image, pictureOf(pictures[i]), cv::NORM_INF), 0.0) << entry.id;
      }
      files += pictures.size();
      kept[entry.id] = pictures;
    }
    EXPECT_EQ(kept, known_.targets());
    EXPECT_EQ(static_cast<std::size_t>(test::entries((file() + "_images").c_str())), files);
    EXPECT_EQ(test::entries(folder_.c_str()), 2);
    return kept == known_.targets();
  }

  /// Shows frames until all that was kept is read; then all of them are checked.
  bool readAgain() {
    TargetDetectionsConstPtr answer;
    do {
      answer = show(scenes_[0]);
      if (!answer) return false;
    } while (answer->known < known_.size());
    for (const TargetScene& one : scenes_) {
      answer = show(one);
      if (!answer || !check(one, *answer)) return false;
    }
    return true;
  }

  bool removeAll() {
    while (known_.size() > 0) {
      if (!remove(known_.drawId(random_))) return false;
    }
    for (int i = 0; i < 2; ++i) {  // with the second one, the index frees its memory
      const TargetDetectionsConstPtr answer = show(scenes_[0]);
      if (!answer || !check(scenes_[0], *answer)) return false;
    }
    return isKept();
  }

  void report(int frame, const Held& now, double seconds) {
    const auto times = feeder_.times();
    std::printf("%8d %6.0f %8.1f %8.3f %6d %8d %8.4f %8.2f %8.2f %8.2f\n", frame,
                times.count / seconds, now.megabytes, now.heap, now.descriptors, now.threads,
                static_cast<double>(tally_.found) / static_cast<double>(tally_.shown), times.p50,
                times.p99, times.max);
    std::fflush(stdout);
  }

  std::string folder_;
  std::vector<TargetScene> scenes_;
  ros::NodeHandle node_;
  ros::Publisher infos_;
  test::Feeder<TargetDetections> feeder_{"/camera/", kTargets + "detections"};
  int number_ = 0;  // number of the next frame
  cv::RNG random_{1};
  Known known_;
  Tally tally_;
  const int frames_ = test::soakFrames(4 * kCycle);
  test::Course course_;
};

TEST(TargetsSoak, NothingGrowsAndNoTargetIsWrong) {
  EXPECT_TRUE(Soak().run());
}

}  // namespace
}  // namespace ktgp_orb
