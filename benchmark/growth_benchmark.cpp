// Measures the time of the growth after PROSAC has found no homography: 640x480, 2000 features, one
// thread, unrelated pictures. The peer is the chain of OpenCV that finds the most hard pairs:
// cv::SIFT with the same number of features in both images, cv::BFMatcher, the ratio test and
// cv::findHomography with USAC_MAGSAC.
//
//   ms_mean, ms_median, ms_p95  CPU time of HomographyGrowth::find alone, over the pairs
//   SIFT_ms                     mean CPU time of OpenCV's chain, over a tenth of the pairs
//   accepted                    pairs in which a homography was found: none should be
//   views_MB                    mean memory of the simulated views of a reference
//
// The pictures are one of each folder below KTGP_ORB_DATA (the Oxford sets and hard/), scaled.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "files/input.h"
#include "ktgp_orb/growth.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "main.h"
#include "support.h"

namespace {

namespace fs = std::filesystem;
using ktgp_orb::Features;
using ktgp_orb::ReferenceViews;
using ktgp_orb::bench::milliseconds;

bool isPicture(const fs::path& path) {
  const std::string ending = path.extension().string();
  return ending == ".ppm" || ending == ".pgm" || ending == ".png" || ending == ".jpg";
}

std::vector<cv::Mat> readPictures() {
  std::vector<cv::Mat> pictures;
  const auto oxford = ktgp_orb::bench::oxfordFolder();
  if (!oxford) return pictures;
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(*oxford).parent_path())) {
    if (entry.is_regular_file() && isPicture(entry.path())) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  fs::path folder;
  for (const fs::path& file : files) {
    if (file.parent_path() == folder) continue;
    folder = file.parent_path();
    cv::Mat image = ktgp_orb::files::readGrey(file.string());
    cv::resize(image, image, cv::Size(640, 480), 0, 0, cv::INTER_AREA);
    pictures.push_back(image);
  }
  return pictures;
}

double siftMilliseconds(const cv::Mat& a, const cv::Mat& b) {
  const double start = milliseconds(true);
  const auto sift = cv::SIFT::create(2000);
  std::vector<cv::KeyPoint> of_a, of_b;
  cv::Mat described_a, described_b;
  sift->detectAndCompute(a, cv::noArray(), of_a, described_a);
  sift->detectAndCompute(b, cv::noArray(), of_b, described_b);
  std::vector<std::vector<cv::DMatch>> nearest;
  cv::BFMatcher(cv::NORM_L2).knnMatch(described_b, described_a, nearest, 2);
  std::vector<cv::Point2f> from, to;
  for (const auto& match : nearest) {
    if (match.size() < 2 || !(match[0].distance < 0.8F * match[1].distance)) continue;
    from.push_back(of_a[static_cast<std::size_t>(match[0].trainIdx)].pt);
    to.push_back(of_b[static_cast<std::size_t>(match[0].queryIdx)].pt);
  }
  if (from.size() >= 4) cv::findHomography(from, to, cv::USAC_MAGSAC, 3.0);
  return milliseconds(true) - start;
}

double megabytes(const ReferenceViews& views) {
  double bytes = 0.0;
  for (const auto& view : views) {
    bytes += static_cast<double>(view.features.keypoints.capacity() * sizeof(cv::KeyPoint) +
                                 view.features.descriptors.total());
  }
  return 1e-6 * bytes;
}

void growth(benchmark::State& state, int views_wanted) {
  cv::setNumThreads(1);
  const std::vector<cv::Mat> pictures = readPictures();
  if (pictures.empty()) {
    state.SkipWithError("KTGP_ORB_DATA names no folder with pictures");
    return;
  }
  const ktgp_orb::OrbOptions orb;
  ktgp_orb::OrbExtractor extractor(orb);
  std::vector<Features> features(pictures.size());
  std::vector<ReferenceViews> views(pictures.size());
  double memory = 0.0;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    extractor.extract(pictures[i], features[i]);
    views[i] = ktgp_orb::simulateViews(pictures[i], orb, views_wanted);
    memory += megabytes(views[i]) / static_cast<double>(pictures.size());
  }
  ktgp_orb::KnnMatcher knn;
  ktgp_orb::HomographyGrowth finder;
  ktgp_orb::GrowthResult result;
  std::vector<ktgp_orb::Correspondence> matches;
  std::vector<double> times;
  double sift = 0.0;
  int sift_pairs = 0;
  int accepted = 0;
  for (auto _ : state) {
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      for (std::size_t j = 0; j < pictures.size(); ++j) {
        if (i == j) continue;
        knn.matchMutual(features[i].descriptors, features[j].descriptors, matches);
        const double start = milliseconds(true);
        finder.find(features[i], &views[i], features[j], matches, result);
        times.push_back(milliseconds(true) - start);
        accepted += result.found ? 1 : 0;
        if (times.size() % 10 != 0) continue;
        sift += siftMilliseconds(pictures[i], pictures[j]);
        ++sift_pairs;
      }
    }
  }
  std::sort(times.begin(), times.end());
  const auto count = static_cast<double>(times.size());
  state.counters["pairs"] = count;
  state.counters["ms_mean"] = std::accumulate(times.begin(), times.end(), 0.0) / count;
  state.counters["ms_median"] = times[times.size() / 2];
  state.counters["ms_p95"] = times[times.size() * 95 / 100];
  state.counters["SIFT_ms"] = sift / std::max(sift_pairs, 1);
  state.counters["accepted"] = accepted;
  state.counters["views_MB"] = memory;
}

BENCHMARK_CAPTURE(growth, none, 0)->Unit(benchmark::kMillisecond)->Iterations(1);
BENCHMARK_CAPTURE(growth, views_13, 13)->Unit(benchmark::kMillisecond)->Iterations(1);

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
