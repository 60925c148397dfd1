#include <ktgp_orb/sequence_matcher.h>

#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  ktgp_orb::SequenceOptions options;
  options.reference.mode = ktgp_orb::ReferenceMode::fixed;
  // The camera may see the picture from any direction.
  options.matcher = ktgp_orb::MatcherOptions::robust();
  options.matcher.growth.views = 13;
  options.orb.max_features = 5000;
  options.orb.distribution = ktgp_orb::KeypointDistribution::uniform;
  ktgp_orb::SequenceMatcher matcher(options);
  const ktgp_orb::FramePtr picture = matcher.newFrame();
  picture->image = cv::imread(argv[1], cv::IMREAD_GRAYSCALE);
  picture->stamp = -1;  // ns; differs from the stamps of the frames
  matcher.setFixedReference(picture);

  cv::VideoCapture video(argv[2]);
  const double rate = video.get(cv::CAP_PROP_FPS);
  cv::Mat colour, grey;
  for (int i = 0; video.read(colour); ++i) {
    cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
    const ktgp_orb::MatchResult& match = matcher.match(grey, i / rate).match;
    std::cout << ktgp_orb::toString(match.status) << ", " << match.inliers << " inliers\n"
              << match.answer.homography << '\n';
  }
}
