#include "evaluation/two_view_evaluation.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/core/version.hpp>
#include <opencv2/features2d.hpp>
#include <sstream>
#include <stdexcept>

#include "files/csv.h"
#include "files/input.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/orb_extractor.h"
#include "util/camera_check.h"
#include "util/format.h"
#include "util/geometry.h"
#include "util/keypoint_position.h"
#include "util/milliseconds.h"

#define KTGP_ORB_HAVE_MAGSAC \
  (CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR > 5))

namespace ktgp_orb::evaluation::two_view {

namespace {

// 99.9 % of chi² with five degrees of freedom, and with the three of a rotation.
constexpr double kBound = 20.515;
constexpr double kBoundOfATurn = 16.266;

using Clock = std::chrono::steady_clock;
using util::format;
using util::millisecondsSince;

struct CameraRow {
  std::string file;
  Eigen::Matrix3d k = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

/// |R R' - 1|: how far the rounded numbers of a file are from a rotation. Infinite for a
/// reflection.
double offARotation(const Eigen::Matrix3d& r) {
  return r.determinant() > 0.0 ? (r * r.transpose() - Eigen::Matrix3d::Identity()).norm()
                               : std::numeric_limits<double>::infinity();
}

/// The lines of a file that are not blank, with their numbers.
std::vector<std::pair<std::string, std::istringstream>> readLines(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw files::FileError(file, "cannot be opened");
  std::vector<std::pair<std::string, std::istringstream>> lines;
  int number = 1;
  for (std::string line; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    lines.emplace_back("line " + std::to_string(number), line);
  }
  return lines;
}

std::vector<CameraRow> readCameras(const std::string& file) {
  constexpr double kMostOff = 1e-3;
  std::vector<CameraRow> rows;
  for (auto& [line, text] : readLines(file)) {
    CameraRow row;
    text >> row.file >> row.k(0, 0) >> row.k(1, 1) >> row.k(0, 2) >> row.k(1, 2);
    for (int i = 0; i < 9; ++i) text >> row.rotation(i / 3, i % 3);
    for (int i = 0; i < 3; ++i) text >> row.translation[i];
    if (!text || !(text >> std::ws).eof()) {
      throw files::FileError(file, line + " is not `file fx fy cx cy R11 ... R33 t1 t2 t3`");
    }
    if (!(offARotation(row.rotation) <= kMostOff)) {
      throw files::FileError(file, line +
                                       " has an R that is no rotation; expected R R' = 1 and "
                                       "det R = 1, and t after the nine numbers of R");
    }
    rows.push_back(row);
  }
  if (rows.empty()) {
    throw files::FileError(file, "has no row `file fx fy cx cy R11 ... R33 t1 t2 t3`");
  }
  return rows;
}

/// The pairs of row numbers in pairs.txt. `count`: the rows of cameras.txt.
std::vector<std::pair<std::size_t, std::size_t>> readPairs(const std::string& file,
                                                           std::size_t count) {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (auto& [line, text] : readLines(file)) {
    auto& [i, j] = pairs.emplace_back();
    if (!(text >> i >> j) || !(text >> std::ws).eof()) {
      throw files::FileError(file, line + " is not two row numbers");
    }
    if (std::max(i, j) < count) continue;
    throw files::FileError(file, line + " has a row number beyond the " + std::to_string(count) +
                                     " rows of cameras.txt, from 0 on");
  }
  if (pairs.empty()) throw files::FileError(file, "names no pair; expected two row numbers a line");
  return pairs;
}

/// The motion between two images. A translation within the rounding of the
/// file, as far as the rotations show it, is none.
void setMotion(const CameraRow& a, const CameraRow& b, PosePair& pair) {
  pair.rotation = b.rotation * a.rotation.transpose();
  pair.translation = b.translation - pair.rotation * a.translation;
  const double rounding =
      std::max(1e-9, 10.0 * std::max(offARotation(a.rotation), offARotation(b.rotation)) *
                         std::max(a.translation.norm(), b.translation.norm()));
  const double length = pair.translation.norm();
  pair.translation = length > rounding ? Eigen::Vector3d(pair.translation / length)
                                       : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

Eigen::Matrix3d fundamentalOf(const PosePair& pair) {
  return pair.target_camera.inverse().transpose() * util::crossed(pair.translation) *
         pair.rotation * pair.reference_camera.inverse();
}

/// Distance in px of the match x, u from the map H of a rotation.
double transfer(const Eigen::Matrix3d& h, const Eigen::Vector2d& x, const Eigen::Vector2d& u) {
  return ((h * x.homogeneous()).hnormalized() - u).norm();
}

double sampson(const Eigen::Matrix3d& f, const Eigen::Vector2d& x, const Eigen::Vector2d& u) {
  const Eigen::Vector3d line = f * x.homogeneous();
  const Eigen::Vector3d back = f.transpose() * u.homogeneous();
  return std::abs(line.dot(u.homogeneous())) /
         std::sqrt(line.head<2>().squaredNorm() + back.head<2>().squaredNorm());
}

double degrees(double radians) {
  return radians * 180.0 / CV_PI;
}

/// The larger error of rotation and direction, degrees; the sign of the translation counts. If the
/// camera only turned, the error of the rotation.
double poseError(const PosePair& truth, const RelativePose& found) {
  const double turn = Eigen::AngleAxisd(found.rotation * truth.rotation.transpose()).angle();
  if (truth.onlyTurns()) return degrees(std::abs(turn));
  const double cosine = found.translation.normalized().dot(truth.translation);
  return degrees(std::max(std::abs(turn), std::acos(std::clamp(cosine, -1.0, 1.0))));
}

/// Squared error of the motion, normalised by its covariance. It has five parameters, or the three
/// of the rotation if the camera only turned.
double normalisedError(const PosePair& truth, const RelativePose& found,
                       const Covariance6& covariance) {
  using Six = Eigen::Matrix<double, 6, 1>;
  const Eigen::AngleAxisd turn(truth.rotation * found.rotation.transpose());
  const Eigen::Vector3d turn_error = turn.angle() * turn.axis();
  const Eigen::Matrix<double, 6, 6> spread = covariance;
  if (truth.onlyTurns()) {
    return turn_error.dot(spread.bottomRightCorner<3, 3>().ldlt().solve(turn_error));
  }
  Six error;
  error << truth.translation - found.translation, turn_error;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(spread);
  const Six parts = solver.eigenvectors().transpose() * error;
  double sum = 0.0;
  for (int i = 1; i < 6; ++i) sum += parts[i] * parts[i] / std::max(solver.eigenvalues()[i], 1e-30);
  return sum;
}

/// Matches of a method, and whether each match is final.
struct Candidates {
  std::vector<Eigen::Vector2d> reference;
  std::vector<Eigen::Vector2d> target;
  std::vector<std::uint8_t> final;

  void add(const cv::Point2f& from, const cv::Point2f& to, bool is_final = false) {
    reference.emplace_back(from.x, from.y);
    target.emplace_back(to.x, to.y);
    final.push_back(is_final ? 1 : 0);
  }
};

void scoreMatches(const PosePair& pair, const Candidates& candidates, PoseScore& score) {
  // A rotation has no epipolar geometry, but a map of the whole image.
  const auto distance = pair.onlyTurns() ? transfer : sampson;
  const Eigen::Matrix3d truth =
      pair.onlyTurns() ? pair.target_camera * pair.rotation * pair.reference_camera.inverse()
                       : fundamentalOf(pair);
  std::size_t right = 0;
  std::size_t right_final = 0;
  for (std::size_t i = 0; i < candidates.final.size(); ++i) {
    const bool is_right =
        distance(truth, candidates.reference[i], candidates.target[i]) < kRightWithin;
    right += is_right;
    right_final += is_right && candidates.final[i] != 0;
    score.matches += candidates.final[i];
  }
  score.kept = right > 0 ? static_cast<double>(right_final) / static_cast<double>(right) : 0.0;
  score.precision = score.matches > 0
                        ? static_cast<double>(right_final) / static_cast<double>(score.matches)
                        : 0.0;
}

/// Uses OpenCV's best estimator of an essential matrix. It takes a single camera, so points of the
/// target are converted to pixels of the reference's camera.
void estimateByOpenCv(const PosePair& pair, Candidates& candidates, PoseScore& score) {
  constexpr double kConfidence = 0.999;
  constexpr double kThreshold = 1.0;  // px
  score.error = std::numeric_limits<double>::infinity();
  if (candidates.final.size() < 6) return;
  const Eigen::Matrix3d same = pair.reference_camera * pair.target_camera.inverse();
  std::vector<cv::Point2d> from;
  std::vector<cv::Point2d> to;
  for (std::size_t i = 0; i < candidates.final.size(); ++i) {
    const Eigen::Vector2d u = (same * candidates.target[i].homogeneous()).hnormalized();
    from.emplace_back(candidates.reference[i].x(), candidates.reference[i].y());
    to.emplace_back(u.x(), u.y());
  }
  cv::Mat k;
  cv::eigen2cv(pair.reference_camera, k);
#if KTGP_ORB_HAVE_MAGSAC
  constexpr int kMethod = cv::USAC_MAGSAC;
#else
  constexpr int kMethod = cv::RANSAC;
#endif
  const auto start = Clock::now();
  cv::Mat mask;
  const cv::Mat e = cv::findEssentialMat(from, to, k, kMethod, kConfidence, kThreshold, mask);
  if (e.rows != 3 || e.cols != 3) return;
  cv::Mat r;
  cv::Mat t;
  cv::Mat front = mask.clone();
  cv::recoverPose(e, from, to, k, r, t, front);
  score.estimation_milliseconds = millisecondsSince(start);
  RelativePose pose;
  cv::cv2eigen(r, pose.rotation);
  Eigen::MatrixXd direction;
  cv::cv2eigen(t, direction);
  pose.translation = direction.col(0);
  score.found = true;
  score.error = poseError(pair, pose);
  for (std::size_t i = 0; i < candidates.final.size(); ++i) {
    candidates.final[i] = mask.at<std::uint8_t>(static_cast<int>(i));
  }
}

/// Matches by the ratio test (`threshold` below 1), or mutual nearest neighbours (1).
Candidates matchByOpenCv(const std::vector<cv::KeyPoint>& reference, const cv::Mat& of_reference,
                         const std::vector<cv::KeyPoint>& target, const cv::Mat& of_target,
                         int norm, double threshold) {
  Candidates out;
  if (reference.size() < 2 || target.size() < 2) return out;
  const auto add = [&](const cv::DMatch& m) {
    out.add(reference[static_cast<std::size_t>(m.trainIdx)].pt,
            target[static_cast<std::size_t>(m.queryIdx)].pt);
  };
  if (threshold >= 1.0) {
    std::vector<cv::DMatch> matches;
    cv::BFMatcher(norm, true).match(of_target, of_reference, matches);
    for (const cv::DMatch& m : matches) add(m);
    return out;
  }
  std::vector<std::vector<cv::DMatch>> matches;
  cv::BFMatcher(norm).knnMatch(of_target, of_reference, matches, 2);
  for (const auto& m : matches) {
    if (m.size() == 2 && m[0].distance < threshold * m[1].distance) add(m[0]);
  }
  return out;
}

using Run = std::function<PoseScore(const PosePair&, const Scene&)>;

Candidates candidatesOf(const Scene& scene, const std::vector<Correspondence>& matches, Level least,
                        Level final) {
  Candidates out;
  for (const Correspondence& c : matches) {
    if (c.level < least) continue;
    out.add(scene.reference.keypoints[static_cast<std::size_t>(c.reference_index)].pt,
            scene.target.keypoints[static_cast<std::size_t>(c.target_index)].pt, c.level >= final);
  }
  return out;
}

Run ours(const MatcherOptions& options) {
  auto matcher = std::make_shared<KtgpMatcher>(options);
  auto result = std::make_shared<MatchResult>();
  return [=](const PosePair& pair, const Scene& scene) {
    PoseScore score;
    MatchHints hints;
    hints.reference_camera = pair.reference_camera;
    hints.target_camera = pair.target_camera;
    const auto start = Clock::now();
    matcher->match(scene.reference, scene.target, hints, *result);
    score.milliseconds = millisecondsSince(start);
    score.estimation_milliseconds = result->stage(StageId::two_view)->milliseconds;
    const TwoView& view = result->two_view.view;
    score.error = std::numeric_limits<double>::infinity();
    score.found = view.geometry != Geometry::none;
    score.geometry = toString(result->geometry);
    score.doubt = toString(view.doubt);
    if (score.found && (pair.onlyTurns() || view.pose.translation.norm() > 0.5)) {
      score.error = poseError(pair, view.pose);
      if (view.pose_covariance.allFinite()) {
        score.normalised = normalisedError(pair, view.pose, view.pose_covariance);
        score.consistent = *score.normalised < (pair.onlyTurns() ? kBoundOfATurn : kBound);
        score.deviation =
            degrees(std::sqrt(std::max(view.pose_covariance.topLeftCorner<3, 3>().trace(),
                                       view.pose_covariance.bottomRightCorner<3, 3>().trace())));
      }
    }
    scoreMatches(pair, candidatesOf(scene, result->correspondences, Level::ktg, Level::ktgp),
                 score);
    return score;
  };
}

/// Runs OpenCV's estimator on the matches of our chain that reach the level `least`.
Run chainAndMagsac(const MatcherOptions& options, Level least) {
  auto matcher = std::make_shared<KtgpMatcher>(options);
  auto result = std::make_shared<MatchResult>();
  return [=](const PosePair& pair, const Scene& scene) {
    PoseScore score;
    const auto start = Clock::now();
    matcher->match(scene.reference, scene.target, *result);
    Candidates candidates = candidatesOf(scene, result->correspondences, least, Level::guided);
    estimateByOpenCv(pair, candidates, score);
    score.milliseconds = millisecondsSince(start);
    scoreMatches(pair, candidates, score);
    return score;
  };
}

/// `shift`: how far the detector's points lie too far right and down, px.
Run openCv(const std::function<cv::Ptr<cv::Feature2D>()>& make, int norm, double threshold,
           float shift = 0.F) {
  const cv::Ptr<cv::Feature2D> detector = make();
  return [=](const PosePair& pair, const Scene& scene) {
    PoseScore score;
    std::vector<cv::KeyPoint> keypoints[2];
    cv::Mat descriptors[2];
    detector->detectAndCompute(scene.reference_image, cv::noArray(), keypoints[0], descriptors[0]);
    detector->detectAndCompute(scene.target_image, cv::noArray(), keypoints[1], descriptors[1]);
    for (auto& points : keypoints) {
      for (cv::KeyPoint& point : points) point.pt -= cv::Point2f(shift, shift);
    }
    const auto start = Clock::now();
    Candidates candidates =
        matchByOpenCv(keypoints[0], descriptors[0], keypoints[1], descriptors[1], norm, threshold);
    estimateByOpenCv(pair, candidates, score);
    score.milliseconds = millisecondsSince(start);
    scoreMatches(pair, candidates, score);
    return score;
  };
}

std::vector<std::pair<std::string, std::function<Run(const PipelineOptions&)>>> methods() {
  return {
    {"SLAM",
     [](const PipelineOptions& options) {
       // Given parameters replace the preset only if they choose a two-view geometry.
       const bool chosen = options.matcher.geometry != GeometryModel::homography;
       return ours(chosen ? options.matcher : MatcherOptions::slam());
     }},
        {"KTGP+MAGSAC++",
         [](const PipelineOptions&) { return chainAndMagsac(MatcherOptions(), Level::ktgp); }},
        {"KTG+MAGSAC++",
         [](const PipelineOptions&) { return chainAndMagsac(MatcherOptions(), Level::ktg); }},
        {"GMS+MAGSAC++",
         [](const PipelineOptions&) {
           MatcherOptions plain;
           plain.ratio_threshold = 1.0;
           return chainAndMagsac(plain, Level::ktg);
         }},
        {"ORB+MAGSAC++",
         [](const PipelineOptions& options) {
           const int features = options.orb.max_features;
           return openCv([=] { return cv::ORB::create(features); }, cv::NORM_HAMMING, 1.0);
         }},
#if KTGP_ORB_HAVE_MAGSAC
        {"SIFT+MAGSAC++", [](const PipelineOptions&) {
           constexpr int kSift = 4000;
           constexpr double kRatio = 0.8;
           constexpr float kSiftShift = 0.25F;  // px, see opencv/opencv issue 23123
           return openCv([] { return cv::SIFT::create(kSift); }, cv::NORM_L2, kRatio, kSiftShift);
         }},
#endif
  };
}

double share(std::size_t count, std::size_t of) {
  return of > 0 ? 100.0 * static_cast<double>(count) / static_cast<double>(of) : 0.0;
}

std::string row(const std::string& set, const std::string& method,
                const std::vector<PoseScore>& scores) {
  std::vector<double> errors;
  std::vector<double> times;
  std::vector<double> estimations;
  std::vector<double> normalised;
  std::vector<double> precision;
  std::vector<double> kept;
  std::size_t found = 0;
  std::size_t within = 0;
  for (const PoseScore& score : scores) {
    errors.push_back(score.error);
    times.push_back(score.milliseconds);
    estimations.push_back(score.estimation_milliseconds);
    kept.push_back(score.kept);
    if (score.matches > 0) precision.push_back(score.precision);
    found += score.found;
    if (!score.normalised) continue;
    normalised.push_back(*score.normalised);
    within += score.consistent;
  }
  std::string out = format("%-26s %-14s %5zu %5.0f", set.c_str(), method.c_str(), scores.size(),
                           share(found, scores.size()));
  for (const double threshold : kPoseThresholds) {
    out += format(" %5.1f", 100.0 * metrics::areaUnderCurve(errors, threshold));
  }
  out += format("  %6.1f %6.1f", 100.0 * metrics::summarize(kept).mean,
                100.0 * metrics::summarize(precision).mean);
  if (normalised.empty()) {
    out += "       -      -";
  } else {
    out += format("  %6.1f %6.1f", share(within, normalised.size()), metrics::median(normalised));
  }
  return out + format("  %7.1f %7.1f\n", metrics::median(times), metrics::median(estimations));
}

/// One line for each pair whose motion is wrong while its covariance excludes the truth.
std::string wrongAndCertain(const std::vector<PosePair>& pairs,
                            const std::vector<std::vector<PoseScore>>& scores,
                            const std::vector<std::string>& methods) {
  constexpr double kWrong = 5.0;  // degrees
  std::string out;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    for (std::size_t m = 0; m < scores[i].size(); ++m) {
      const PoseScore& score = scores[i][m];
      if (!score.found || !(score.error > kWrong) || !score.normalised) continue;
      if (score.consistent) continue;
      out += format("%s %s, %s: %s, error %.1f degrees, deviation %.2f, doubt %s\n",
                    pairs[i].set.c_str(), pairs[i].name.c_str(), methods[m].c_str(),
                    score.geometry.c_str(), score.error, score.deviation, score.doubt.c_str());
    }
  }
  return out.empty() ? out : "\nwrong by more than 5 degrees, and certain (beyond 99.9 %):\n" + out;
}

}  // namespace

std::vector<PosePair> findPosePairs(const std::string& folder, const std::vector<int>& apart,
                                    Dataset& dataset) {
  namespace fs = std::filesystem;
  const std::string cameras = folder + "/cameras.txt";
  const std::string list = folder + "/pairs.txt";
  std::vector<std::string>& read = dataset.files;
  read.insert(read.end(), {cameras, list});
  const std::vector<CameraRow> rows = readCameras(cameras);
  for (const CameraRow& row : rows) read.push_back(folder + "/" + row.file);
  const std::string set = nameOfSet(folder, dataset.sets);
  std::vector<PosePair> pairs;
  const auto add = [&](std::size_t i, std::size_t j, const std::string& name) {
    const CameraRow& a = rows[i];
    const CameraRow& b = rows[j];
    PosePair pair;
    pair.set = name;
    pair.name = a.file + " " + b.file;
    pair.reference = folder + "/" + a.file;
    pair.target = folder + "/" + b.file;
    pair.reference_camera = a.k;
    pair.target_camera = b.k;
    setMotion(a, b, pair);
    pairs.push_back(pair);
  };
  if (fs::exists(list)) {
    for (const auto& [i, j] : readPairs(list, rows.size())) add(i, j, set);
    return pairs;
  }
  for (const int distance : apart) {
    const auto step = static_cast<std::size_t>(distance);
    if (step >= rows.size()) {
      throw files::FileError(cameras, "has " + std::to_string(rows.size()) + " rows: no pair is " +
                                          std::to_string(distance) + " rows apart");
    }
    for (std::size_t i = 0; i + step < rows.size(); ++i) {
      add(i, i + step, set + ", " + std::to_string(distance) + " apart");
    }
  }
  return pairs;
}

std::vector<std::string> methodNames() {
  std::vector<std::string> names;
  for (const auto& method : methods()) names.push_back(method.first);
  return names;
}

PoseEvaluator::PoseEvaluator(const PipelineOptions& options, const std::vector<std::string>& wanted)
    : extractor_(withImages(options.orb)) {
  const auto all = methods();
  for (const std::string& name : wanted) {
    const auto found = std::find_if(all.begin(), all.end(),
                                    [&](const auto& method) { return method.first == name; });
    if (found == all.end()) {
      std::string error = "there is no method ";
      error.append(name).append(" of two views; expected one of");
      for (const std::string& known : methodNames()) error.append(" ").append(known);
      throw std::invalid_argument(error);
    }
    runs_.push_back(found->second(options));
  }
}

std::vector<PoseScore> PoseEvaluator::evaluate(const PosePair& pair) {
  const cv::Mat reference = files::readGrey(pair.reference);
  const cv::Mat target = files::readGrey(pair.target);
  const auto require = [](const std::string& file, const Eigen::Matrix3d& k, const cv::Mat& image) {
    util::requireK("K of " + file, k, image.size());
    util::requirePrincipalPoint("K of " + file, k, image.size());
  };
  require(pair.reference, pair.reference_camera, reference);
  require(pair.target, pair.target_camera, target);
  extractor_.extract(reference, reference_);
  extractor_.extract(target, target_);
  std::vector<PoseScore> scores;
  for (const Run& run : runs_)
    scores.push_back(run(pair, {reference, target, reference_, target_}));
  return scores;
}

std::string toTable(const std::vector<PosePair>& pairs,
                    const std::vector<std::vector<PoseScore>>& scores,
                    const std::vector<std::string>& methods) {
  std::string out =
      "set                        method         pairs found    AUC at 1, 2, 5, 10 deg    kept  "
      "right   99.9 %  NEES   ms all ms view\n";
  std::vector<std::string> sets;
  for (const PosePair& pair : pairs) {
    if (std::find(sets.begin(), sets.end(), pair.set) == sets.end()) sets.push_back(pair.set);
  }
  for (const std::string& set : sets) {
    for (std::size_t m = 0; m < methods.size(); ++m) {
      std::vector<PoseScore> of_set;
      for (std::size_t i = 0; i < pairs.size(); ++i) {
        if (pairs[i].set == set && m < scores[i].size()) of_set.push_back(scores[i][m]);
      }
      out += row(set, methods[m], of_set);
    }
  }
  return out + wrongAndCertain(pairs, scores, methods);
}

std::string toCsv(const std::vector<PosePair>& pairs,
                  const std::vector<std::vector<PoseScore>>& scores,
                  const std::vector<std::string>& methods) {
  std::string out =
      "set,pair,method,found,geometry,error,deviation,doubt,matches,kept,precision,normalised,"
      "milliseconds,"
      "estimation_milliseconds\n";
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    for (std::size_t m = 0; m < scores[i].size(); ++m) {
      const PoseScore& score = scores[i][m];
      files::CsvRow row;
      row.add(pairs[i].set).add(pairs[i].name).add(methods[m]).add(score.found ? 1 : 0);
      row.add(score.geometry).add(score.error, 6).add(score.deviation, 4).add(score.doubt);
      row.add(score.matches).add(score.kept, 4);
      row.add(score.precision, 4);
      row.add(score.normalised.value_or(std::numeric_limits<double>::quiet_NaN()), 5);
      row.add(score.milliseconds, 4).add(score.estimation_milliseconds, 4);
      out += row.line();
    }
  }
  return out;
}

}  // namespace ktgp_orb::evaluation::two_view
