// Compares the cost of a call from Python with the same call from C++, both in this process on the
// same two images, in turn. Prints a Markdown table with the median CPU time of a call, ms.
//   match()             extractor and matcher are made for each call
//   Extractor, Matcher  both keep their buffers; in Python each image has its own features
//   Sequence            one image per call, matched to the previous image
// The Python code also reads the homography, its covariance, and the points and levels of all
// correspondences. Run it where Python finds the module: after `source devel/setup.bash`.
#include <pybind11/embed.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <functional>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"

namespace {

namespace py = pybind11;
using ktgp_orb::Features;
using ktgp_orb::MatchResult;

constexpr int kRuns = 201;

constexpr const char* kPython = R"(
import numpy, ktgp_orb_core as ktgp
a, b = numpy.array(first, copy=False), numpy.array(second, copy=False)
extractor, matcher = ktgp.Extractor(), ktgp.Matcher()
def read(found):
    return (found.status, found.homography, found.covariance, found.reference_points, found.target_points,
            found.levels)
def once():
    return read(ktgp.match(a, b))
def again():
    return read(matcher.match(extractor.extract(a), extractor.extract(b)))
sequence, images, seconds = ktgp.Sequence('ktgp'), [a, b], iter(range(1, 1000000))
def frame():
    images.reverse()
    return read(sequence.match(images[0], next(seconds) / 30))
)";

py::memoryview viewOf(const cv::Mat& image) {
  return py::memoryview::from_buffer(image.data, {image.rows, image.cols},
                                     {static_cast<long>(image.step), 1L});
}

double milliseconds(const std::function<void()>& call) {
  const std::clock_t start = std::clock();
  call();
  return 1000.0 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void compare(const char* name, const std::function<void()>& cpp,
             const std::function<void()>& python) {
  std::vector<double> of_cpp, of_python, more;
  for (int i = 0; i < kRuns; ++i) {
    of_cpp.push_back(milliseconds(cpp));
    of_python.push_back(milliseconds(python));
    more.push_back(100.0 * (of_python.back() / of_cpp.back() - 1.0));
  }
  std::printf("| %s | %.2f | %.2f | %+.1f %% | %+.1f %% |\n", name, median(of_cpp),
              median(of_python), 100.0 * (median(of_python) / median(of_cpp) - 1.0), median(more));
}

}  // namespace

int main() {
  const cv::Mat first = ktgp_orb::test::textureImage({640, 480}, 1);
  cv::Mat second;
  const cv::Mat motion = (cv::Mat_<double>(2, 3) << 0.99, -0.05, 12.0, 0.05, 0.99, -7.0);
  cv::warpAffine(first, second, motion, first.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);

  const py::scoped_interpreter interpreter;
  const py::dict names;
  names["first"] = viewOf(first);
  names["second"] = viewOf(second);
  py::exec(kPython, names);
  const py::object once = names["once"];
  const py::object again = names["again"];

  ktgp_orb::OrbExtractor extractor;
  ktgp_orb::KtgpMatcher matcher;
  Features reference, target;
  MatchResult result;
  std::puts(
      "| | C++, ms | Python, ms | medians | median of each pair of calls |\n|---|---|---|---|---|");
  compare(
      "`match()`",
      [&] {
        ktgp_orb::OrbExtractor own_extractor;
        ktgp_orb::KtgpMatcher own_matcher;
        Features own_reference, own_target;
        MatchResult own_result;
        own_extractor.extract(first, own_reference);
        own_extractor.extract(second, own_target);
        own_matcher.match(own_reference, own_target, own_result);
      },
      [&] { once(); });
  compare(
      "`Extractor`, `Matcher`",
      [&] {
        extractor.extract(first, reference);
        extractor.extract(second, target);
        matcher.match(reference, target, result);
      },
      [&] { again(); });
  ktgp_orb::SequenceMatcher sequence;
  int frames = 0;
  const py::object frame = names["frame"];
  compare(
      "`Sequence`",
      [&] {
        ++frames;
        sequence.match(frames % 2 == 0 ? first : second, frames / 30.0);
      },
      [&] { frame(); });
  return 0;
}
