#include "ktgp_orb/mosaic.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "homography/transform.h"
#include "ktgp_orb/frame_path.h"
#include "metrics/repetition.h"
#include "mosaic/keyframes.h"
#include "mosaic/tile_map.h"
#include "mosaic/turn.h"
#include "util/format.h"
#include "util/names.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

using mosaic::TileMap;
using mosaic::Turn;

constexpr std::size_t kPathLength = 300;  // frames that may arrive while one frame is being placed
// A frame becomes a keyframe if the keyframes cover less than this share of the frame. The next
// frame then overlaps enough with a keyframe for a reliable match.
constexpr double kKeyframeOverlap = 0.6;
// A frame is drawn if the view has moved by at least this share of the frame's width. A smaller
// motion would hardly be visible.
constexpr double kLeastMotion = 0.03;
// A new map begins if frames have been lost for kLostSeconds (s) and more than kLostFrames frames
// have been lost. Until then, each new frame is searched for in the old map. kLostFrames matters
// for photographs, because they arrive seldom, and one or two of them may be blurred.
constexpr double kLostSeconds = 1.0;
constexpr int kLostFrames = 3;
// A position is predicted from the last velocity for at most this time, ns. An acceleration of 3
// m/s² moves a camera by 15 mm in this time.
constexpr std::int64_t kPredictable = 100'000'000;
// A pose that is less than this many px from its prediction is taken as right. The value is half of
// the shortest period that can be found in a frame of 400 px.
constexpr double kNoSurprise = 4.0;
// A frame looks like the map if Impl::difference() is less than this. Measured on drawn slabs and
// solar panels: 0.3 to 3 at the right place, 1.2 to 4 a period off. Noise stronger than the dirt in
// which periods differ gives at least 2/3 anywhere, as the map is a mean of up to three frames.
constexpr double kSame = 0.5;
// A frame and its copy a period away must differ by at least this (1 - correlation), otherwise
// nothing tells the two places apart. Where drawn windows differ by 0.007, single frames measured
// 0.019. Without this limit, 3 of 144 flights over slabs and windows were placed a period off.
constexpr double kToldApart = 0.03;
// If two keyframes predict places of the frame that are farther apart than this share of the
// frame's shorter side, the ground has two places that look alike. (Repetition at shorter distances
// is detected in the frame itself.) Smaller differences are normal: keyframes of a large map may
// have drifted apart by some px.
constexpr double kElsewhere = 0.1;
// The last frame before a gap becomes a keyframe if the keyframes cover less than this share of it.
constexpr double kCoveredBeforeGap = 0.9;
// If a frame deviates from a pure turn by more than this multiple of largestOff(), the camera has
// moved.
constexpr double kMoved = 4.0;
// Number of poses that are kept for testTurn(). The test is repeated while the distance between the
// middles of the newest and the first frame is between kFirstTest and kLastTest, in frame widths.
constexpr std::size_t kTurnPoses = 20;
constexpr double kFirstTest = 0.25;
constexpr double kLastTest = 4.0;
// Deviation of the pairs from a plane that counts as parallax, px. Measured: 0.02 in a flight over
// flat ground, 0.3 over a table that is filmed by hand, 0.8 over a patio.
constexpr double kParallax = 0.5;

std::size_t tilesFor(const MosaicOptions& options) {
  constexpr double kTile = TileMap::kTileSize * TileMap::kTileSize;
  return static_cast<std::size_t>(std::max(1.0, 1e6 * options.max_megapixels / kTile));
}

OrbOptions withImages(OrbOptions orb, bool alignment) {
  orb.images = alignment ? ImageKeeping::copy : ImageKeeping::none;
  return orb;
}

}  // namespace

const char* toString(Placement placement) {
  return util::nameOf<Placement::lost>(placement, {"drawn", "seen", "new_map", "lost"});
}

struct Mosaic::Impl {
  explicit Impl(const MosaicOptions& o)
      : options(o),
        extractor(withImages(o.orb, o.matcher.alignment.enabled)),
        path(kPathLength),
        tiles(tilesFor(o)),
        keyframes(o.matcher) {}

  MosaicOptions options;
  std::function<void(const cv::Mat&)> finished;
  OrbExtractor extractor;
  FramePath path;
  TileMap tiles;
  mosaic::Keyframes keyframes;
  std::optional<Eigen::Matrix3d> camera;    // matrix of the camera, if given
  Turn turn;                                // last result of testTurn() for this map
  std::vector<Eigen::Matrix3d> turn_poses;  // poses of drawn frames, spread over the map
  double next_test = kFirstTest;            // distance at which testTurn() runs next, frame widths
  double closed_off = 0.0;                  // largest distance found by noteClosing(), px
  cv::Size size;
  cv::Mat grey;
  std::optional<double> own_difference;  // of `grey` from its own copy a period away
  cv::Mat colour;
  cv::Mat exposed;  // `colour`, adjusted to the brightness of the map
  cv::Mat seen;     // newest frame (BGR) if it is not drawn yet; image() draws it
  std::optional<Eigen::Matrix3d> seen_pose;

  std::optional<Eigen::Matrix3d> last;  // homography map -> last frame with a known position
  std::int64_t last_stamp = 0;          // stamp of the frame of `last`
  // Features of the frame of `last`, unless it is a keyframe.
  std::optional<Features> last_features;
  std::optional<Eigen::Vector2d> velocity;  // velocity of the frame's middle, px of the map per ns
  std::optional<Eigen::Matrix3d> pose;      // pose of the newest frame; empty if it is not placed
  Eigen::Matrix3d drawn = Eigen::Matrix3d::Identity();  // pose of the last drawn frame
  std::int64_t followed = 0;                            // stamp of the newest homography
  std::int64_t interval = 0;                            // usual time between two homographies, ns
  // Stamp of the last homography that came late, or of the last frame that was lost as repetitive.
  std::int64_t after_gap = 0;
  std::int64_t first_stamp = 0;
  std::int64_t lost_since = 0;
  int lost_frames = 0;  // number of frames lost since lost_since
  LostBecause reason = LostBecause::nothing;
  int unchecked = 0;  // frames since the last match to a keyframe
  bool is_full = false;
  std::size_t maps = 0;

  void clearMap() {
    tiles.clear();
    seen_pose.reset();
    keyframes.clear();
    is_full = false;
    turn = {};
    turn_poses.clear();
    next_test = kFirstTest;
    closed_off = 0.0;
  }

  const mosaic::Surface& surface() const { return tiles.surface(); }

  void startMap(std::int64_t stamp, Features features) {
    if (finished && !tiles.area().empty()) finished(image());
    clearMap();
    ++maps;
    first_stamp = stamp;
    last.reset();
    settle(stamp, Eigen::Matrix3d::Identity());
    if (options.keyframes) keyframes.add(std::move(features), *pose);
    draw(colour, *pose);
  }

  void draw(const cv::Mat& frame, const Eigen::Matrix3d& from_map) {
    drawn = from_map;
    const Eigen::Matrix3d to_map = surface().scaled(from_map.inverse());
    if (options.gain) frame.convertTo(exposed, CV_8UC3, tiles.gain(frame, to_map));
    is_full = !tiles.draw(options.gain ? exposed : frame, to_map) || is_full;
    seen_pose.reset();
  }

  cv::Mat image() {
    if (seen_pose) draw(seen, *seen_pose);
    return tiles.image(1.0);
  }

  Features find() {
    Features features;
    extractor.extract(grey, features);
    return features;
  }

  bool hasRoom() const {
    // This number of keyframes is enough for a map without gaps. It bounds the memory if the camera
    // stays over one place.
    const double most = 1e6 * options.max_megapixels / (0.3 * size.area());
    return options.keyframes && !is_full && keyframes.size() < static_cast<std::size_t>(most) + 1;
  }

  bool hasMoved() const {
    const Eigen::Matrix3d to_now = *pose * drawn.inverse();
    const double least = kLeastMotion * size.width;
    for (const Eigen::Vector2d& corner : homography::imageCorners(size, {})) {
      if (((to_now * corner.homogeneous()).hnormalized() - corner).norm() >= least) return true;
    }
    return false;
  }

  /// The homography map -> frame, computed from the position of the last placed frame and the chain
  /// of homographies since then.
  std::optional<Eigen::Matrix3d> chained(std::int64_t stamp) const {
    if (!last) return std::nullopt;
    const auto step = path.between(last_stamp, stamp);
    if (!step) return std::nullopt;
    return surface().fitted(*step * *last, size);
  }

  Eigen::Vector2d middleInMap(const Eigen::Matrix3d& from_map) const {
    return surface().toMap(from_map.inverse() * middle().homogeneous());
  }
  Eigen::Vector2d middle() const { return {0.5 * (size.width - 1), 0.5 * (size.height - 1)}; }

  /// Records when a homography comes late, because in the meantime the frame may have moved by
  /// several periods of repetitive ground.
  void noteGap(std::int64_t stamp) {
    constexpr std::int64_t kLate = 3;  // intervals
    const std::int64_t passed = stamp - followed;
    const bool is_late = interval > 0 && passed > kPredictable && passed > kLate * interval;
    if (is_late) after_gap = stamp;
    if (!is_late) interval = followed == 0 ? 0 : std::max<std::int64_t>(passed, 0);
    followed = stamp;
  }

  bool isPredictable(std::int64_t stamp) const {
    return velocity && stamp - last_stamp < kPredictable;
  }

  /// Returns the place in the map where the last velocity leads the middle of the frame.
  Eigen::Vector2d predictedMiddle(std::int64_t stamp) const {
    return middleInMap(*last) + static_cast<double>(stamp - last_stamp) * *velocity;
  }

  /// Returns true if the pose may be wrong by a period of repetitive ground. It is right if the
  /// last velocity predicts it, or if the frame looks like the map (see difference()). Otherwise a
  /// chain of homographies must lead to the frame. A chain over a gap, or over a frame that was
  /// lost as repetitive, does not count, because such a homography may be a period off, too. If the
  /// frame does not repeat itself, the chain is enough. If it does, the last velocity, if it is not
  /// too old, must predict the pose to within half a period or the predicted motion, whichever is
  /// longer. If the velocity predicts a motion of at least half a period, or is too old, the chain
  /// must predict the pose to within half a period.
  bool mayBeAnotherPeriod(std::int64_t stamp, const Eigen::Matrix3d& from_map,
                          const std::optional<Eigen::Matrix3d>& by_chain) {
    const auto in_frame = [&](const Eigen::Vector2d& place) {
      return surface().inFrame(from_map, place);
    };
    const auto surprise = [&](const Eigen::Vector2d& place) {
      return (in_frame(place) - middle()).norm();
    };
    const bool is_predictable = isPredictable(stamp);
    const Eigen::Vector2d before = middleInMap(*last);
    const Eigen::Vector2d predicted = is_predictable ? predictedMiddle(stamp) : before;
    if (is_predictable && surprise(predicted) < kNoSurprise) return false;
    const double half_period = 0.5 * metrics::shortestPeriod(grey);
    const bool has_chain = by_chain && last_stamp >= after_gap;
    if (half_period == 0.0 && has_chain) return false;
    if (difference(from_map) < kSame) return false;
    if (!has_chain) return true;
    const double way = (in_frame(predicted) - in_frame(before)).norm();
    if (is_predictable && surprise(predicted) > std::max(half_period, way)) return true;
    if (is_predictable && way < half_period) return false;
    return surprise(middleInMap(*by_chain)) > half_period;
  }

  /// Compares the frame, placed by `from_map`, with the map. Returns the difference (1 -
  /// correlation) divided by the difference between the frame and the same frame shifted by one
  /// period: about 0 if the place is right, 1 or more if it is wrong by a period. Returns 1 if the
  /// frame repeats itself so exactly that it looks alike at both places.
  double difference(const Eigen::Matrix3d& from_map) {
    const cv::Mat copy = metrics::shrunk(grey);
    Eigen::Matrix3d from_copy = Eigen::Matrix3d::Identity();
    for (const auto& [axis, scale] : {std::pair(0, static_cast<double>(grey.cols) / copy.cols),
                                      std::pair(1, static_cast<double>(grey.rows) / copy.rows)}) {
      from_copy(axis, axis) = scale;
      from_copy(axis, 2) = 0.5 * scale - 0.5;
    }
    const TileMap::View map =
        tiles.view(copy.size(), surface().scaled(from_map.inverse()) * from_copy);
    cv::Mat shown;
    cv::cvtColor(map.colour, shown, cv::COLOR_BGR2GRAY);
    if (!own_difference) own_difference = 1.0 - metrics::alikenessToItself(copy);
    if (*own_difference < kToldApart) return 1.0;
    return (1.0 - metrics::alikeness(copy, shown, map.mask)) / *own_difference;
  }

  /// Chooses between the places that the map and the chain of homographies give. If the ground
  /// looks the same at both places, takes the place where the frame looks like the map, otherwise
  /// the place that the last velocity predicts, or none. If the ground looks different, takes the
  /// place that the map gives.
  std::optional<Eigen::Matrix3d> chosenPlace(std::int64_t stamp, const Eigen::Matrix3d& by_map,
                                             const Eigen::Matrix3d& by_chain) {
    constexpr double kExact = 3.0;  // px: accuracy of a match at the rim of a keyframe
    constexpr double kDrift = 0.2;  // px of drift per frame since the last match to a keyframe
    const auto shift = [&](const Eigen::Matrix3d& from_map, const Eigen::Vector2d& place) {
      return Eigen::Vector2d(surface().inFrame(from_map, place) - middle());
    };
    const Eigen::Vector2d apart = shift(by_map, middleInMap(by_chain));
    if (apart.norm() < kExact + kDrift * unchecked) return by_map;
    if (!metrics::repeatsAfter(grey, {apart.x(), apart.y()})) return by_map;
    // At the end of a full turn, the chain has drifted by a few px. Any picture still looks similar
    // after a shift by a few px, so this does not count as repetition.
    if (!surface().isPlane() && metrics::shortestPeriod(grey) == 0.0) return by_map;
    for (const Eigen::Matrix3d& place : {by_map, by_chain}) {
      if (surface().canShow(size, place) && difference(place) < kSame) return place;
    }
    if (!isPredictable(stamp)) return std::nullopt;
    const Eigen::Vector2d predicted = predictedMiddle(stamp);
    for (const Eigen::Matrix3d& place : {by_map, by_chain}) {
      if (shift(place, predicted).norm() < kNoSurprise) return place;
    }
    return std::nullopt;
  }

  void settle(std::int64_t stamp, const Eigen::Matrix3d& from_map) {
    pose = surface().fitted(from_map, size);
    velocity.reset();
    if (last && stamp > last_stamp) {
      const Eigen::Vector2d before = middleInMap(*last);
      velocity = (surface().near(middleInMap(*pose), before) - before) /
                 static_cast<double>(stamp - last_stamp);
    }
    last = pose;
    last_stamp = stamp;
    after_gap = std::min(after_gap, stamp);  // stamps go back if a recording begins again
    last_features.reset();
    lost_frames = 0;
    reason = LostBecause::nothing;
  }

  Placement lose(std::int64_t stamp, LostBecause why, Features features = {}) {
    pose.reset();
    reason = why;
    if (why == LostBecause::repeats) after_gap = stamp;
    if (lost_frames++ == 0) lost_since = stamp;
    const double waited = 1e-9 * static_cast<double>(stamp - lost_since);
    const bool is_patient = waited < kLostSeconds || lost_frames <= kLostFrames;
    if (last && waited >= 0.0 && is_patient) return Placement::lost;
    startMap(stamp, features.empty() && options.keyframes ? find() : std::move(features));
    return Placement::new_map;
  }

  /// Finds the place of the frame from the keyframes and the chain of homographies. Sets `reason`
  /// if it finds no place.
  std::optional<Eigen::Matrix3d> search(std::int64_t stamp, const Features& features,
                                        const std::optional<Eigen::Matrix3d>& by_chain) {
    std::optional<Eigen::Matrix3d> found = by_chain;
    if (options.keyframes) {
      const auto places =
          keyframes.locate(features, by_chain.value_or(*last), by_chain.has_value());
      unchecked = places.empty() ? unchecked + 1 : 0;
      if (!places.empty()) {
        found = by_chain ? chosenPlace(stamp, places.front(), *by_chain) : places.front();
        reason = LostBecause::repeats;
        if (!found) return std::nullopt;
        if (!surface().isPlane()) reason = LostBecause::moved;
        if (!isOnePlace(places)) return std::nullopt;
        if (by_chain) noteClosing(*found, *by_chain);
      }
    }
    reason = LostBecause::unmatched;
    if (!found) return found;
    reason = LostBecause::moved;
    if (surface().off(*found, size) > kMoved * mosaic::largestOff(size)) return std::nullopt;
    if (!surface().canShow(size, *found)) found = by_chain;
    reason = LostBecause::zoomed;
    if (!found) return found;
    reason = LostBecause::repeats;
    if (mayBeAnotherPeriod(stamp, *found, by_chain)) return std::nullopt;
    return found;
  }

  /// Returns true if all keyframes that match the frame give nearly the same place (see
  /// kElsewhere).
  bool isOnePlace(const std::vector<Eigen::Matrix3d>& places) const {
    const double far = kElsewhere * std::min(size.width, size.height);
    const Eigen::Vector2d place = middleInMap(places.front());
    return std::all_of(places.begin(), places.end(), [&](const Eigen::Matrix3d& from_map) {
      return (surface().inFrame(from_map, place) - middle()).norm() < far;
    });
  }

  /// Returns true if the map shows a full turn. Its width is in whole px, so less than 1 px may be
  /// missing.
  bool isClosed() const {
    return !surface().isPlane() && tiles.area().width + 1 > surface().period();
  }

  /// Records the largest drift of the chain of homographies over a full turn, px: the distance
  /// between the place of a frame by the chain and its place by the keyframes of the beginning of
  /// the turn.
  void noteClosing(const Eigen::Matrix3d& by_map, const Eigen::Matrix3d& by_chain) {
    if (!isClosed()) return;
    const double off = (surface().inFrame(by_map, middleInMap(by_chain)) - middle()).norm();
    closed_off = std::max(closed_off, off);
  }

  /// Keeps the pose of a drawn frame, and tests from time to time whether the camera only turns.
  void noteTurn() {
    const bool is_known = !surface().isPlane() || turn.verdict == Turn::Verdict::moves;
    if (is_known || next_test > kLastTest) return;
    turn_poses.push_back(*pose);
    if (turn_poses.size() > kTurnPoses) {  // keep every second pose
      std::size_t kept = 0;
      for (std::size_t i = 1; i < turn_poses.size(); i += 2) turn_poses[kept++] = turn_poses[i];
      turn_poses.resize(kept);
    }
    const double way = (middleInMap(*pose) - middle()).norm() / size.width;
    if (way < next_test) return;
    next_test = 1.25 * way;
    bend();
  }

  /// Changes the map from the plane to a cylinder if the camera has only turned so far. Returns
  /// true if the map has changed.
  bool bend() {
    if (!surface().isPlane()) return false;
    turn = mosaic::testTurn(turn_poses, size, camera);
    if (turn.verdict != Turn::Verdict::turns) return false;
    const mosaic::Surface cylinder(turn.camera, turn.axis);
    const auto to_cylinder = [&](const Eigen::Matrix3d& from_map) {
      return cylinder.fitted(from_map, size);
    };
    const bool can_show = std::all_of(
        turn_poses.begin(), turn_poses.end(),
        [&](const Eigen::Matrix3d& each) { return cylinder.canShow(size, to_cylinder(each)); });
    if (!can_show || !tiles.bend(cylinder)) return false;
    keyframes.move(to_cylinder);
    for (auto* each : {&last, &pose, &seen_pose}) {
      if (*each) *each = to_cylinder(**each);
    }
    drawn = to_cylinder(drawn);
    // The old velocity is in px of the plane, so it is not valid on the cylinder.
    velocity.reset();
    return true;
  }

  /// Explains to users why the map is not drawn on a cylinder.
  std::string whyNoCylinder() const {
    const double focal = turn.camera(0, 0);
    if (turn.verdict == Turn::Verdict::moves) {
      return util::format("it does not only turn: the homographies are %.1f px off any turn",
                          turn.off);
    }
    if (turn.verdict == Turn::Verdict::turns) return "it turns about an axis that it sees";
    if (turn.degrees == 0.0) return "too few frames were placed to tell whether it only turns";
    if (turn.is_estimated) {
      return util::format(
          "no focal length is known (no camera_info fits the images), and the "
          "homographies tell none: if it is %.0f px, they are %.1f px off a turn",
          focal, turn.off);
    }
    return util::format("at the focal length of %.0f px it has turned by %.0f degrees only", focal,
                        turn.degrees);
  }

  /// Draws the placed frame if the view has moved enough since the last drawn frame.
  Placement show() {
    if (!hasMoved()) {
      colour.copyTo(seen);
      seen_pose = pose;
      return Placement::seen;
    }
    draw(colour, *pose);
    noteTurn();
    return Placement::drawn;
  }

  Placement place(std::int64_t stamp) {
    std::optional<Eigen::Matrix3d> expected = chained(stamp);
    if (!last) return lose(stamp, LostBecause::unmatched);
    bool is_zoomed = expected && !surface().canShow(size, *expected);
    if (is_zoomed && bend()) {
      expected = chained(stamp);
      is_zoomed = !surface().canShow(size, *expected);
    }
    if (is_zoomed) expected.reset();
    // A frame after a gap overlaps most with the last frame before the gap, so we make this last
    // frame a keyframe.
    if (!expected && last_features && hasRoom() &&
        keyframes.coverage(size, *last) < kCoveredBeforeGap) {
      keyframes.add(std::move(*last_features), *last);
      last_features.reset();
    }
    Features features;
    if (options.keyframes) features = find();
    const std::optional<Eigen::Matrix3d> found = search(stamp, features, expected);
    if (!found) {
      if (is_zoomed && reason == LostBecause::unmatched) reason = LostBecause::zoomed;
      if (reason == LostBecause::unmatched && metrics::shortestPeriod(grey) > 0.0) {
        reason = LostBecause::repeats;
      }
      return lose(stamp, reason, std::move(features));
    }
    settle(stamp, *found);
    if (hasRoom() && keyframes.coverage(size, *pose) < kKeyframeOverlap) {
      keyframes.add(std::move(features), *pose);
    } else {
      last_features = std::move(features);
    }
    return show();
  }
};

Mosaic::Mosaic(const MosaicOptions& options) {
  util::requireInRange("max_megapixels", options.max_megapixels, 1.0, 1000.0);
  impl_ = std::make_unique<Impl>(options);
}

Mosaic::~Mosaic() = default;
Mosaic::Mosaic(Mosaic&&) noexcept = default;
Mosaic& Mosaic::operator=(Mosaic&&) noexcept = default;

const MosaicOptions& Mosaic::options() const {
  return impl_->options;
}

void Mosaic::setOptions(const MosaicOptions& options) {
  util::requireInRange("max_megapixels", options.max_megapixels, 1.0, 1000.0);
  impl_->extractor = OrbExtractor(withImages(options.orb, options.matcher.alignment.enabled));
  impl_->keyframes.setOptions(options.matcher);
  if (options.orb.descriptor != impl_->options.orb.descriptor) {
    impl_->keyframes.clear();
    impl_->last_features.reset();
  }
  impl_->tiles.setMaxTiles(tilesFor(options));
  impl_->is_full = false;
  impl_->options = options;
}

void Mosaic::setCamera(const std::optional<Eigen::Matrix3d>& camera) {
  impl_->camera = camera;
}

void Mosaic::follow(std::int64_t stamp, std::int64_t reference_stamp,
                    const std::optional<Eigen::Matrix3d>& homography) {
  impl_->path.add(stamp, reference_stamp, homography);
  impl_->noteGap(stamp);
}

Placement Mosaic::place(std::int64_t stamp, const cv::Mat& image) {
  Impl& self = *impl_;
  self.own_difference.reset();
  if (image.type() == CV_8UC1) {
    self.grey = image;
    cv::cvtColor(image, self.colour, cv::COLOR_GRAY2BGR);
  } else if (image.type() == CV_8UC3) {
    cv::cvtColor(image, self.grey, cv::COLOR_BGR2GRAY);
    self.colour = image;
  } else {
    throw std::invalid_argument("image of a mosaic is of OpenCV type " +
                                std::to_string(image.type()) + "; expected CV_8UC1 or CV_8UC3");
  }
  if (image.size() != self.size) {
    self.last.reset();
    self.size = image.size();
  }
  const Placement placement = self.place(stamp);
  self.grey.release();
  self.colour.release();
  return placement;
}

void Mosaic::onFinishedMap(std::function<void(const cv::Mat&)> callback) {
  impl_->finished = std::move(callback);
}

std::optional<Eigen::Matrix3d> Mosaic::pose() const {
  return impl_->pose;
}

LostBecause Mosaic::lostBecause() const {
  return impl_->reason;
}

std::int64_t Mosaic::firstStamp() const {
  return impl_->first_stamp;
}

cv::Mat Mosaic::image() const {
  return impl_->image();
}

cv::Mat Mosaic::picture(int longest) const {
  const cv::Rect area = impl_->tiles.area();
  if (area.empty()) return {};
  const double scale =
      std::min(1.0, static_cast<double>(std::max(1, longest)) / std::max(area.width, area.height));
  const cv::Mat image = impl_->tiles.image(scale);
  cv::Mat alpha;
  cv::extractChannel(image, alpha, 3);
  cv::Mat colour;
  cv::cvtColor(image, colour, cv::COLOR_BGRA2BGR);
  cv::Mat shown(image.size(), CV_8UC3, cv::Scalar::all(40));
  colour.copyTo(shown, alpha);
  if (!impl_->pose) return shown;
  constexpr int kBits = 4;
  std::vector<cv::Point> outline;
  for (const Eigen::Vector2d& corner : impl_->tiles.outline(impl_->size, impl_->pose->inverse())) {
    const Eigen::Vector2d p =
        scale * (corner - Eigen::Vector2d(area.x, area.y)) * static_cast<double>(1 << kBits);
    outline.emplace_back(static_cast<int>(std::lround(p.x())),
                         static_cast<int>(std::lround(p.y())));
  }
  const int stroke = std::max(2, std::max(shown.cols, shown.rows) / 400);
  cv::polylines(shown, outline, true, cv::Scalar::all(0), stroke + 2, cv::LINE_AA, kBits);
  cv::polylines(shown, outline, true, cv::Scalar::all(255), stroke, cv::LINE_AA, kBits);
  return shown;
}

cv::Rect Mosaic::area() const {
  return impl_->tiles.area();
}

double Mosaic::megapixels() const {
  return 1e-6 * static_cast<double>(impl_->tiles.tiles()) * TileMap::kTileSize * TileMap::kTileSize;
}

bool Mosaic::full() const {
  return impl_->is_full;
}

std::size_t Mosaic::keyframes() const {
  return impl_->keyframes.size();
}

std::size_t Mosaic::maps() const {
  return impl_->maps;
}

std::optional<Panorama> Mosaic::panorama() const {
  const mosaic::Surface& surface = impl_->surface();
  if (surface.isPlane()) return std::nullopt;
  Panorama panorama;
  panorama.camera = impl_->turn.camera;
  panorama.axis = impl_->turn.axis;
  panorama.is_estimated = impl_->turn.is_estimated;
  panorama.degrees = impl_->isClosed() ? 360.0 : 360.0 * area().width / surface.period();
  panorama.closed_off = impl_->closed_off;
  return panorama;
}

std::string Mosaic::whyLost() const {
  if (impl_->reason == LostBecause::moved) {
    return "the camera turned at first, so the map is on a cylinder, and then moved aside: frames "
           "that no turn leads to are lost";
  }
  if (impl_->reason != LostBecause::zoomed) return {};
  if (!impl_->surface().isPlane()) {
    return "the camera looks too far along the axis of its turn: frames with a pixel that would "
           "cover more than 4 of the cylinder are lost";
  }
  return "the camera has turned, tilted or moved too far for one plane: frames of less than 1/4 or "
         "more than 4 times the map's scale are lost, and a cylinder cannot show them, since " +
         impl_->whyNoCylinder();
}

double Mosaic::planeDeviation() const {
  return impl_->keyframes.planeDeviation();
}

bool Mosaic::hasParallax() const {
  return planeDeviation() > kParallax;
}

void Mosaic::reset() {
  impl_->clearMap();
  impl_->path.clear();
  impl_->last.reset();
  impl_->pose.reset();
  impl_->lost_frames = 0;
  impl_->reason = LostBecause::nothing;
}

}  // namespace ktgp_orb
