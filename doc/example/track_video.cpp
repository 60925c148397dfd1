#include <ktgp_orb/sequence_matcher.h>

#include <iostream>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  cv::VideoCapture video(argv[1]);
  const double rate = video.get(cv::CAP_PROP_FPS);
  ktgp_orb::SequenceOptions options;
  // Errors add up from keyframe to keyframe; with `previous`, from frame to frame.
  options.reference.mode = ktgp_orb::ReferenceMode::keyframe;
  ktgp_orb::SequenceMatcher matcher(options);
  cv::Mat colour, grey;
  for (int i = 0; video.read(colour); ++i) {
    cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
    const ktgp_orb::SequenceMatch& frame = matcher.match(grey, i / rate);
    if (!frame.reference) std::cout << ktgp_orb::toString(frame.no_reference) << '\n';
    if (!frame.accumulated) continue;  // the first frame, or nothing to be recognised
    std::cout << frame.match.inliers << " inliers; from the first frame to this one:\n"
              << frame.accumulated->homography << '\n';
  }
}
