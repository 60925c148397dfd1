#include <ktgp_orb/opencv.h>

#include <iostream>
#include <opencv2/imgcodecs.hpp>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const cv::Ptr<cv::Feature2D> features = ktgp_orb::createFeature2D();
  std::vector<cv::KeyPoint> first, second;
  cv::Mat of_first, of_second;
  features->detectAndCompute(cv::imread(argv[1]), cv::noArray(), first, of_first);
  features->detectAndCompute(cv::imread(argv[2]), cv::noArray(), second, of_second);
  std::vector<cv::DMatch> matches;
  cv::BFMatcher(features->defaultNorm(), true).match(of_first, of_second, matches);

  std::vector<cv::Point2f> from, to;
  std::vector<float> noise;  // px: large keypoints are found less accurately
  for (const cv::DMatch& match : matches) {
    from.push_back(first[match.queryIdx].pt);
    to.push_back(second[match.trainIdx].pt);
    noise.push_back(second[match.trainIdx].size / 31);
  }
  const ktgp_orb::ProsacResult found = ktgp_orb::estimateHomography(from, to, noise);
  std::cout << ktgp_orb::toString(found.status) << ", " << found.inliers << " inliers\n"
            << found.answer.homography << "\ncovariance of its first eight entries:\n"
            << found.answer.covariance << '\n';
  return found.status == ktgp_orb::Status::ok ? 0 : 1;
}
