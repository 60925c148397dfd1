#include <ktgp_orb/ktgp_matcher.h>
#include <ktgp_orb/orb_extractor.h>

#include <iostream>
#include <opencv2/imgcodecs.hpp>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  ktgp_orb::OrbExtractor extractor;  // default options: the paper's
  ktgp_orb::KtgpMatcher matcher;
  ktgp_orb::Features reference, target;  // all of these are reused from frame to frame
  ktgp_orb::MatchResult result;

  extractor.extract(cv::imread(argv[1], cv::IMREAD_GRAYSCALE), reference);
  extractor.extract(cv::imread(argv[2], cv::IMREAD_GRAYSCALE), target);
  matcher.match(reference, target, result);

  std::cout << ktgp_orb::toString(result.status) << ", " << result.inliers << " inliers\n"
            << result.answer.homography << '\n';
  return result.status == ktgp_orb::Status::ok ? 0 : 1;
}
