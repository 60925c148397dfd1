#pragma once

#include <pybind11/numpy.h>

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/features.h"

namespace ktgp_orb::python {

namespace py = pybind11;

/// An image in NumPy's memory, which `owner` keeps alive.
struct ImageArray {
  py::array owner;
  cv::Mat pixels;
};

/// An array (height, width) as CV_8UC1, or (height, width, 3) as CV_8UC3. The order of the colours
/// is blue, green, red, as in files that OpenCV reads. Dense rows of uint8 are not copied. Alpha is
/// removed, and the pixels that it hides are replaced (see util::fillHidden). uint16 grey is
/// stretched as in the programs, and uint16 colours lose their lower bits. Throws py::value_error,
/// which names the image, its type or shape, and what is expected. Also throws for a masked array
/// with hidden values.
ImageArray imageArray(const py::object& image, const std::string& name);

/// An image as CV_8UC1. Colours are converted to grey, then stretched.
ImageArray greyImage(const py::object& image, const std::string& name);

/// A mask as CV_8UC1, or an empty matrix for None.
ImageArray maskImage(const py::object& mask);

/// The keypoints as (N, 6) float32: x, y, size, angle, response, octave.
py::array_t<float> keypointArray(const Features& features);
/// The descriptors as read-only (N, 32) uint8, in memory of `features` that `owner` keeps alive.
py::array_t<std::uint8_t> descriptorArray(const Features& features, const py::object& owner);
/// The keypoints as a list of cv2.KeyPoint. Imports cv2.
py::list cvKeypoints(const Features& features);

/// Features from keypoints and their descriptors. The keypoints are an array, as keypointArray()
/// returns it, or a list of cv2.KeyPoint. `image_size`: (width, height). Throws py::value_error.
Features featuresFrom(const py::object& keypoints, const py::object& descriptors,
                      const std::pair<int, int>& image_size, const std::string& descriptor);

/// A read-only array of shape (N,) in the memory of `values`, which `owner` keeps alive.
template <typename Number>
py::array_t<Number> view(const std::vector<Number>& values, const py::object& owner) {
  py::array_t<Number> out(static_cast<py::ssize_t>(values.size()), values.data(), owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

/// A read-only array of points, of shape (N, 2) or (N, 3), in the memory of `points`.
template <int Size>
py::array_t<double> view(const std::vector<Eigen::Matrix<double, Size, 1>>& points,
                         const py::object& owner) {
  const auto* const numbers = reinterpret_cast<const double*>(points.data());
  py::array_t<double> out({static_cast<py::ssize_t>(points.size()), py::ssize_t{Size}}, numbers,
                          owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

}  // namespace ktgp_orb::python
