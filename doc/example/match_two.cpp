#include <ktgp_orb/pair_matcher.h>

#include <iostream>
#include <opencv2/imgcodecs.hpp>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const cv::Mat reference = cv::imread(argv[1], cv::IMREAD_GRAYSCALE);
  const cv::Mat target = cv::imread(argv[2], cv::IMREAD_GRAYSCALE);
  const ktgp_orb::MatchResult result = ktgp_orb::matchPair(reference, target).match;

  std::cout << ktgp_orb::toString(result.status) << ", " << result.inliers << " inliers\n"
            << result.answer.homography << '\n';
  return result.status == ktgp_orb::Status::ok ? 0 : 1;
}
