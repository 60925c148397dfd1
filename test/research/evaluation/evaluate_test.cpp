// The methods that ktgp_evaluate compares, step by step.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>

#include "evaluation/methods.h"
#include "evaluation/output.h"
#include "evaluation/sequence_evaluation.h"
#include "evaluation/truth_points.h"
#include "files/input.h"
#include "frame_pair.h"
#include "ktgp_orb/metrics.h"
#include "orb_test_images.h"
#include "refusal.h"

namespace ktgp_orb::evaluation {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Two thirds of the keypoints move by (12, 5); the others are random.
struct RandomScene : test::FramePair {
  explicit RandomScene(int n, unsigned seed = 1)
      : FramePair(test::drawnPair(n, n - n / 3, test::translation(12.0, 5.0), seed, 0, 12)),
        grey(test::noiseImage({640, 480}, seed)) {}
  Scene scene() const { return {grey, grey, reference, target}; }

  cv::Mat grey;
};

/// Features with the given descriptors, all at one position.
Features described(const std::vector<std::vector<uchar>>& descriptors) {
  Features features;
  features.image_size = {100, 100};
  features.descriptors = cv::Mat::zeros(static_cast<int>(descriptors.size()), 32, CV_8U);
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    features.keypoints.emplace_back(cv::Point2f(50.F, 50.F), 31.F);
    std::copy(descriptors[i].begin(), descriptors[i].end(),
              features.descriptors.ptr(static_cast<int>(i)));
  }
  return features;
}

/// Target indices left after one step over the given matches.
std::vector<int> left(const Step& step, const Scene& scene, std::vector<Correspondence> matches) {
  Matching m;
  m.matches = std::move(matches);
  step.run(scene, m);
  std::vector<int> indices;
  for (const Correspondence& c : m.matches) indices.push_back(c.target_index);
  return indices;
}

using Indices = std::vector<int>;
const cv::Mat kNoImage(100, 100, CV_8U, cv::Scalar(0));

TEST(Steps, RatioKeepsMatchesBelow) {
  const Features f = described({{0}, {0}, {0}});
  const Scene scene{kNoImage, kNoImage, f, f};
  EXPECT_EQ(left(ratio(0.5), scene, {{0, 0, 5, 10}, {0, 1, 4, 10}, {0, 2, 0, 0}}), Indices{1});
}

TEST(Steps, DistanceThresholdIsTwiceTheSmallestOrTheFloor) {
  const Features f = described({{0}, {0}, {0}});
  const Scene scene{kNoImage, kNoImage, f, f};
  EXPECT_EQ(left(distanceThreshold(30), scene, {{0, 0, 5, 9}, {0, 1, 30, 40}, {0, 2, 31, 40}}),
            (Indices{0, 1}));
  EXPECT_EQ(left(distanceThreshold(30), scene, {{0, 0, 20, 9}, {0, 1, 40, 45}, {0, 2, 41, 45}}),
            (Indices{0, 1}));
}

TEST(Steps, BidirectionalKeepsMutualNeighbours) {
  // Reference 0 is nearest to both target descriptors; only target 1 is nearest to it.
  const Features reference = described({{0x0F}, {0xFF, 0xFF}});
  const Features target = described({{0x07}, {0x0F}});
  Matching m;
  const Scene scene{kNoImage, kNoImage, reference, target};
  nearest({}).run(scene, m);
  ASSERT_EQ(m.matches.size(), 2u);
  bidirectional({}).run(scene, m);
  ASSERT_EQ(m.matches.size(), 1u);
  EXPECT_EQ(m.matches[0].target_index, 1);
}

TEST(Steps, MutualNearestIsNearestAndBidirectional) {
  const RandomScene random(300);
  Matching expected;
  nearest({}).run(random.scene(), expected);
  bidirectional({}).run(random.scene(), expected);
  Matching ours;
  mutualNearest({}).run(random.scene(), ours);
  ASSERT_EQ(ours.matches.size(), expected.matches.size());
  EXPECT_LT(ours.matches.size(), 300u);
  for (std::size_t i = 0; i < ours.matches.size(); ++i) {
    EXPECT_EQ(ours.matches[i].target_index, expected.matches[i].target_index);
    EXPECT_EQ(ours.matches[i].reference_index, expected.matches[i].reference_index);
  }
}

TEST(Steps, CosineOfBinaryVectorsByHand) {
  // 4 ones and 2 ones, 2 of them common: cosine 2 / sqrt(8) = 0.7071, distance 2.
  const Features reference = described({{0x0F}});
  const Features target = described({{0x03}});
  const Scene scene{kNoImage, kNoImage, reference, target};
  EXPECT_EQ(left(cosineSimilarity(0.70), scene, {{0, 0, 2, 9}}), Indices{0});
  EXPECT_EQ(left(cosineSimilarity(0.71), scene, {{0, 0, 2, 9}}), Indices{});
}

TEST(Steps, NormsByHand) {
  const Features reference = described({{30, 40}});  // 50
  const Features target = described({{0, 45}, {0, 44}});
  const Scene scene{kNoImage, kNoImage, reference, target};
  EXPECT_EQ(left(similarNorm(0.1), scene, {{0, 0, 2, 9}, {0, 1, 2, 9}}), Indices{0});
}

TEST(Steps, EuclideanDistanceByHand) {
  // Distances 0, 0, 0, 10: mean 2.5, standard deviation 4.33.
  const Features reference = described({{10}});
  const Features target = described({{10}, {10}, {10}, {20}});
  const Scene scene{kNoImage, kNoImage, reference, target};
  EXPECT_EQ(left(euclideanDistance(), scene, {{0, 0}, {0, 1}, {0, 2}, {0, 3}}), (Indices{0, 1, 2}));
}

TEST(Steps, GreyLevelIgnoresGainAndOffsetOfTheWholeImage) {
  cv::Mat image(100, 100, CV_8U, cv::Scalar(20));
  image(cv::Rect(50, 0, 50, 100)).setTo(100);
  const cv::Mat brighter = image * 2 + 30;
  Features f = described({{0}, {0}});
  f.keypoints[0].pt = {20.F, 50.F};
  f.keypoints[1].pt = {80.F, 50.F};
  const Scene scene{image, brighter, f, f};
  EXPECT_EQ(left(greyLevel(0.1), scene, {{0, 0}, {0, 1}}), Indices{0});
}

TEST(GridStatistics, OverThreeByThreeCellsAreGms) {
  for (int n = 0; n <= 1200; n += 60) {
    for (double factor : {0.0, 2.0, 6.0}) {
      const RandomScene random(n, static_cast<unsigned>(n + 1));
      GmsOptions options;
      options.threshold = factor;
      Matching ours;
      nearest({}).run(random.scene(), ours);
      Matching expected = ours;
      gms(options).run(random.scene(), expected);
      gmsOver(square(1), options).run(random.scene(), ours);
      ASSERT_EQ(ours.matches.size(), expected.matches.size()) << n << " at " << factor;
      for (std::size_t i = 0; i < ours.matches.size(); ++i) {
        ASSERT_EQ(ours.matches[i].target_index, expected.matches[i].target_index);
      }
    }
  }
}

TEST(GridStatistics, NeighbourhoodsHaveTheirNumberOfCells) {
  EXPECT_EQ(square(1).size(), 9u);
  EXPECT_EQ(square(2).size(), 25u);
  EXPECT_EQ(cross().size(), 5u);
}

class Estimators : public ::testing::TestWithParam<std::string> {};

TEST_P(Estimators, FindTheHomographyAmongOutliers) {
  Eigen::Matrix3d h;
  h << 1.05, 0.08, -14.0, -0.06, 0.97, 21.0, 1e-4, -5e-5, 1.0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    test::Numbers numbers(seed);
    const PointPairs pairs = test::makePairs({200, 140, h}, numbers);
    const ProsacResult e = estimateHomography(GetParam(), pairs, {640, 480}, {});
    ASSERT_EQ(e.status, Status::ok);
    EXPECT_LT(metrics::cornerError(e.answer.homography, h, {640, 480}), 1.5) << seed;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const double error =
          (metrics::project(e.answer.homography, pairs.reference[i]) - pairs.target[i]).norm();
      ASSERT_EQ(e.mask[i] != 0, error < 3.0);
    }
  }
}

TEST_P(Estimators, SurviveEverySmallSet) {
  for (int n = 0; n <= 40; ++n) {
    test::Numbers numbers(5);
    const PointPairs pairs = test::makePairs({static_cast<std::size_t>(n), 0}, numbers);
    const ProsacResult e = estimateHomography(GetParam(), pairs, {640, 480}, {});
    EXPECT_EQ(e.mask.size(), pairs.size());
    EXPECT_TRUE(n >= 4 || e.status != Status::ok);
  }
}

TEST_P(Estimators, SurvivePointsThatAreAllTheSame) {
  PointPairs pairs;
  for (int i = 0; i < 30; ++i) {
    pairs.add({10.0, 10.0}, {20.0, 20.0}, 0.5);
  }
  const ProsacResult e = estimateHomography(GetParam(), pairs, {640, 480}, {});
  EXPECT_EQ(e.mask.size(), 30u);
}

INSTANTIATE_TEST_SUITE_P(All, Estimators, ::testing::ValuesIn(estimators()),
                         [](const auto& info) { return info.param; });

TEST(Methods, HaveUniqueAndExpectedNames) {
  std::set<std::string> names;
  for (const Method& method : allMethods({})) EXPECT_TRUE(names.insert(method.name).second);
  for (const char* name :
       {"ORB",        "ORB+RANSAC", "KT",         "KTG",        "KTGP",          "KTG-RS",
        "KTGP-RS",    "GMS",        "MUTUAL",     "KTGP+ALIGN", "MUTUAL+ALIGN",  "GMS-5",
        "GMS5x5",     "GMS-RANSAC", "MP-ORB",     "KRCR",       "KTBER",         "Sun2016",
        "KTG+ransac", "KTG+msac",   "KTG+mlesac", "ROBUST",     "ROBUST-TEBLID", "ROBUST-GROWTH",
        "HARD",       "HARD-VIEWS"}) {
    EXPECT_EQ(names.count(name), 1u) << name;
  }
}

Method methodNamed(const std::string& name, const PipelineOptions& options = {}) {
  for (const Method& method : allMethods(options)) {
    if (method.name == name) return method;
  }
  throw std::invalid_argument(name);
}

TEST(Methods, KtgpIsTheMatcher) {
  const RandomScene random(900);
  const MatchResult expected = test::matched(random);
  ASSERT_EQ(expected.status, Status::ok);
  std::vector<StepResult> steps;
  const Matching m = runMethod(methodNamed("KTGP"), random.scene(), steps);
  ASSERT_EQ(steps.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(steps[i].matches, expected.stages[i].output);
  ASSERT_TRUE(m.answer.has_value());
  EXPECT_EQ(m.answer->homography, expected.prosac.answer.homography);
}

TEST(Methods, AlignedMethodsEqualTheMatcher) {
  cv::Mat picture = test::noiseImage({720, 560}, 3);
  cv::GaussianBlur(picture, picture, {0, 0}, 3.0);
  cv::normalize(picture, picture, 0, 255, cv::NORM_MINMAX);
  const cv::Mat moved =
      test::warped(picture, test::translation(6.3, 4.6), picture.size(), cv::INTER_LINEAR);
  const cv::Mat reference = picture({40, 40, 640, 480}).clone();
  const cv::Mat target = moved({40, 40, 640, 480}).clone();
  PipelineOptions options;
  options.orb.max_features = 500;
  for (const auto& [name, matcher, descriptor] :
       {std::tuple("KTGP+ALIGN", MatcherOptions(), DescriptorKind::orb),
        {"ROBUST", MatcherOptions::robust(), DescriptorKind::orb},
        {"ROBUST-TEBLID", MatcherOptions::robust(), DescriptorKind::teblid}}) {
    SCOPED_TRACE(name);
    OrbOptions orb = options.orb;
    orb.descriptor = descriptor;
    const test::FramePair pair(reference, target, orb);
    const MatchResult expected = test::matched(pair, matcher);
    ASSERT_EQ(expected.alignment.status, AlignmentStatus::ok);
    std::vector<StepResult> steps;
    const Matching m = runMethod(methodNamed(name, options),
                                 {reference, target, pair.reference, pair.target}, steps);
    ASSERT_TRUE(m.answer.has_value());
    EXPECT_EQ(m.answer->homography, expected.answer.homography);
    EXPECT_EQ(m.matches.size(), expected.inliers);
  }
}

TEST(Methods, RunOnEveryNumberOfFeatures) {
  std::vector<Method> methods = allMethods({});
  std::vector<StepResult> steps;
  for (int n : {0, 1, 2, 3, 4, 5, 8, 13, 50, 200}) {
    const RandomScene random(n);
    for (const Method& method : methods) {
      const Matching m = runMethod(method, random.scene(), steps);
      if (m.own) continue;  // finds keypoints in the picture
      EXPECT_LE(m.matches.size(), static_cast<std::size_t>(n)) << method.name;
      for (std::size_t i = 1; i < steps.size(); ++i) {
        EXPECT_LE(steps[i].matches, steps[i - 1].matches) << method.name;
      }
    }
  }
}

TEST(Methods, TakeTheEstimatorThatIsAskedFor) {
  for (const Method& method : allMethods({}, "msac")) {
    const auto is_another = [](const Step& step) {
      return step.name == "ransac" || step.name == "prosac" || step.name == "usac" ||
             step.name == "magsac";
    };
    const bool sampled = std::any_of(method.steps.begin(), method.steps.end(), is_another);
    EXPECT_TRUE(!sampled || method.name.rfind("KTG+", 0) == 0) << method.name;
  }
}

// --- averages ---

PairScore scoreOf(const std::string& set, std::size_t matches, double corner_error) {
  PairScore pair;
  pair.pair.set = set;
  MethodScore m;
  m.method = "M";
  m.matches = matches;
  m.descriptor_distance = {matches, 10.0 * static_cast<double>(matches), 1.0};
  m.corner_error = corner_error;
  pair.methods.push_back(m);
  return pair;
}

TEST(Summary, AveragesOverPairsBySetAndOverAll) {
  std::vector<PairScore> scores{scoreOf("a", 2, 1.0), scoreOf("a", 0, kInfinity),
                                scoreOf("b", 4, 0.0)};
  PairScore broken;
  broken.pair.set = "b";
  broken.problem = "b.png: cannot be opened";
  scores.push_back(broken);
  const std::vector<SetSummary> s = summarizeSets(scores);
  ASSERT_EQ(s.size(), 3u);
  EXPECT_EQ(s[0].set, "a");
  EXPECT_EQ(s[0].pairs, 2u);
  EXPECT_DOUBLE_EQ(s[0].matches, 1.0);
  EXPECT_DOUBLE_EQ(s[0].descriptor_distance.mean, 20.0) << "a pair without matches has no distance";
  EXPECT_DOUBLE_EQ(s[0].accuracy->auc[3], 0.475);
  EXPECT_EQ(s[1].pairs, 1u) << "the broken pair does not count";
  EXPECT_EQ(s[2].set, "all");
  EXPECT_DOUBLE_EQ(s[2].matches, 2.0);
}

TEST(Output, EveryRowHasEveryColumn) {
  const std::string csv = toCsv({scoreOf("a,\"b\"", 2, kInfinity)});
  std::istringstream in(csv);
  std::string header;
  std::string row;
  std::getline(in, header);
  std::getline(in, row);
  EXPECT_EQ(row.rfind("\"a,\"\"b\"\"\",", 0), 0u) << row;
  row.erase(0, std::string("\"a,\"\"b\"\"\"").size());
  EXPECT_EQ(std::count(header.begin(), header.end(), ','), std::count(row.begin(), row.end(), ','));
  EXPECT_EQ(csv.find("inf"), std::string::npos);
}

// --- sequences ---

/// The camera's view after `i` steps of (3, 2) px.
cv::Mat view(int i) {
  static const cv::Mat world = test::blockImage({800, 600}, 3, 120);
  return world(cv::Rect(3 * i, 2 * i, 320, 240)).clone();
}

const Eigen::Matrix3d kStep = test::translation(-3.0, -2.0);

TEST(Sequence, FollowsASteadyCamera) {
  SequenceEvaluator evaluator({}, {}, 5);
  for (int i = 0; i < 12; ++i) evaluator.addFrame(100.0 + 0.1 * i, view(i), kStep);
  const SequenceScore score = evaluator.score();
  ASSERT_EQ(score.frames.size(), 12u);
  EXPECT_EQ(score.frames[0].status, Status::no_reference);
  EXPECT_FALSE(score.frames[0].drift.has_value());
  for (std::size_t i = 1; i < 12; ++i) {
    const FrameScore& f = score.frames[i];
    EXPECT_NEAR(f.time, 0.1 * static_cast<double>(i), 1e-9);
    EXPECT_EQ(f.status, Status::ok);
    EXPECT_GT(f.inlier_ratio, 0.8);
    EXPECT_EQ(f.keypoints, f.matches[0]);
    EXPECT_LT(f.corner_error.value_or(99.0), 1.5);
    EXPECT_LT(f.drift.value_or(99.0), 4.0);
  }
  // A window of five frames begins at frames 1, 6 and 11.
  for (std::size_t i : {1, 6, 11}) {
    EXPECT_NEAR(*score.frames[i].drift, *score.frames[i].corner_error, 1e-9);
  }
  ASSERT_EQ(score.survival.size(), 11u);
  EXPECT_DOUBLE_EQ(score.survival[0], 1.0);
  for (std::size_t k = 1; k < 11; ++k) {
    EXPECT_LE(score.survival[k], score.survival[k - 1] + 0.05);
    EXPECT_GT(score.survival[k], 0.02);
  }
}

TEST(Sequence, TracksAndDriftEndAtAFrameThatShowsNothing) {
  SequenceEvaluator evaluator({}, {}, 0);
  for (int i = 0; i < 7; ++i) {
    const bool blank = i == 3;
    evaluator.addFrame(i, blank ? test::flatImage({320, 240}, 0) : view(i), kStep);
  }
  const SequenceScore score = evaluator.score();
  EXPECT_EQ(score.frames[3].status, Status::too_few_features);
  EXPECT_EQ(score.frames[4].status, Status::too_few_features);
  EXPECT_FALSE(score.frames[3].drift.has_value());
  EXPECT_NEAR(*score.frames[5].drift, *score.frames[5].corner_error, 1e-9) << "it restarts";
  EXPECT_GT(score.survival[1], 0.0);
  EXPECT_EQ(score.survival[2], 0.0) << "no track can be longer than two matches";
}

TEST(Sequence, WithoutTruthThereIsNoDrift) {
  SequenceEvaluator evaluator({}, {}, 30);
  for (int i = 0; i < 3; ++i) evaluator.addFrame(i, view(i), std::nullopt);
  const SequenceScore score = evaluator.score();
  EXPECT_EQ(score.frames[2].status, Status::ok);
  EXPECT_FALSE(score.frames[2].corner_error.has_value());
  EXPECT_FALSE(score.frames[2].drift.has_value());
  EXPECT_EQ(toJson(score)["frames"].size(), 3u);
}

TEST(Sequence, AcceptsNoFramesAndOneFrame) {
  SequenceEvaluator evaluator({}, {}, 30);
  EXPECT_TRUE(evaluator.score().frames.empty());
  EXPECT_TRUE(evaluator.score().survival.empty());
  evaluator.addFrame(0.0, view(0), std::nullopt);
  EXPECT_EQ(evaluator.score().frames.size(), 1u);
  EXPECT_TRUE(evaluator.score().survival.empty());
}

// --- annotated points as truth: what is read, what is refused, how a homography is held to them
// ---

std::string written(const std::string& text) {
  const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
  const std::string file =
      (std::filesystem::temp_directory_path() / (std::string(test->name()) + ".points")).string();
  std::ofstream(file) << text;
  return file;
}

const std::string kRows = "0 0 10 20\n100 0 110 20\r\n\n 100 50\t110 70\n0.5 50 10.5 7e1\n";

TEST(TruthPoints, AreReadRowByRow) {
  const std::vector<AnnotatedPoint> points = readPoints(written(kRows));
  ASSERT_EQ(points.size(), 4U);
  EXPECT_EQ(points[2].reference, Eigen::Vector2d(100, 50));
  EXPECT_EQ(points[3].target, Eigen::Vector2d(10.5, 70));
}

TEST(TruthPoints, NeedFourNumbersARowAndFourRows) {
  for (const auto& [text, words] :
       {std::pair<std::string, const char*>("0 0 1 1\n1 0 2 1\n1 1 2 2\n", "holds 3"),
        {"", "holds 0"},
        {kRows + "1 2 3\n", "line 6"},
        {kRows + "1 2 3 4 5\n1 2 3\n", "line 6"},
        {"a b c d\n" + kRows, "line 1"},
        {kRows + "1 2 3 nan\n", "line 6"}}) {
    const std::string file = written(text);
    test::expectRefused<files::FileError>([&] { readPoints(file); }, words);
  }
  EXPECT_THROW(readPoints("/nowhere/at.all"), files::FileError);
}

TEST(TruthPoints, DetermineAHomographyUnlessOnALine) {
  const Eigen::Matrix3d h = homographyThrough(readPoints(written(kRows)), "a.points");
  EXPECT_NEAR(h(0, 2) / h(2, 2), 10.0, 1e-9);
  EXPECT_NEAR(h(1, 2) / h(2, 2), 20.0, 1e-9);
  const std::vector<AnnotatedPoint> same(4, {{1, 2}, {3, 4}});
  const auto refused = [](const std::vector<AnnotatedPoint>& points) {
    test::expectRefused<files::FileError>([&] { homographyThrough(points, "a.points"); },
                                          "a.points: the annotated points determine no homography");
  };
  refused(same);
  // Whole numbers near a line in every direction, in one of the images, and one point beside it.
  for (int degrees = 0; degrees < 180; degrees += 7) {
    const double angle = CV_PI * degrees / 180.0;
    std::vector<AnnotatedPoint> points{{{500, 90}, {400, 120}}};
    for (const double along : {-190.0, -70.0, 20.0, 150.0, 210.0}) {
      const Eigen::Vector2d on_line(300.0 + std::round(along * std::cos(angle)),
                                    200.0 + std::round(along * std::sin(angle)));
      points.push_back({on_line, {along, 0.004 * along * along}});
    }
    refused(points);
    for (AnnotatedPoint& point : points) std::swap(point.reference, point.target);
    refused(points);
  }
  // Two of the points are at the same place.
  const std::vector<AnnotatedPoint> twice{
      {{0, 0}, {1, 1}}, {{0, 0}, {1, 1}}, {{100, 0}, {101, 1}}, {{0, 100}, {1, 101}}};
  refused(twice);
}

TEST(TruthPoints, NeedNoFourWhichAreFarFromAllLines) {
  // The corners of a triangle, and the middles of two sides.
  std::vector<AnnotatedPoint> points;
  for (const auto& [x, y] : {std::pair{0, 0}, {100, 0}, {0, 100}, {50, 0}, {50, 50}}) {
    points.push_back({{x, y}, {x + 10, y + 20}});
  }
  EXPECT_NEAR(homographyThrough(points, "")(0, 2), 10.0, 1e-9);
}

TEST(TruthPoints, TheErrorIsTheMeanDistance) {
  std::vector<AnnotatedPoint> points{{{0, 0}, {3, 4}}, {{10, 0}, {10, 0}}};
  EXPECT_DOUBLE_EQ(meanTransferError(Eigen::Matrix3d::Identity(), points), 2.5);
  Eigen::Matrix3d horizon = Eigen::Matrix3d::Identity();
  horizon.row(2) << 1.0, 0.0, -10.0;  // through the second point
  EXPECT_TRUE(std::isinf(meanTransferError(horizon, points)));
}

TEST(TruthPoints, CovarianceMatchesErrors) {
  UncertainHomography estimate;
  estimate.homography.setIdentity();
  estimate.covariance.setZero();
  std::vector<AnnotatedPoint> points{{{0, 0}, {5, 0}}, {{10, 0}, {15, 0}}};
  EXPECT_FALSE(isWithinCovariance(estimate, points, 1.0));  // 5 px are five deviations
  EXPECT_TRUE(isWithinCovariance(estimate, points, 2.0));
  estimate.covariance(2, 2) = 25.0;  // variance of the shift along x
  EXPECT_TRUE(isWithinCovariance(estimate, points, 1.0));
}

}  // namespace
}  // namespace ktgp_orb::evaluation
