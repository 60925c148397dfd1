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

/// An array without a copy where its rows are dense uint8: (height, width) as CV_8UC1, or (height,
/// width, 3) in the order blue, green, red, as OpenCV reads files, as CV_8UC3. Alpha is left out,
/// and what it hides is replaced (see util::fillHidden); of uint16, grey is stretched as the
/// programs do, and colours lose their lower bits. Throws py::value_error, which names the image,
/// its type or shape, and what is expected; also for a masked array with hidden values.
ImageArray imageArray(const py::object& image, const std::string& name);

/// An image as CV_8UC1; colours are converted, then stretched.
ImageArray greyImage(const py::object& image, const std::string& name);

/// A mask as CV_8UC1, or an empty matrix for None.
ImageArray maskImage(const py::object& mask);

/// (N, 6) float32: x, y, size, angle, response, octave.
py::array_t<float> keypointArray(const Features& features);
/// (N, 32) uint8, in the memory of `features`, which `owner` keeps alive; read-only.
py::array_t<std::uint8_t> descriptorArray(const Features& features, const py::object& owner);
/// A list of cv2.KeyPoint. Imports cv2.
py::list cvKeypoints(const Features& features);

/// Features from keypoints, an array as of keypointArray() or a list of cv2.KeyPoint, and their
/// descriptors. `image_size`: (width, height). Throws py::value_error.
Features featuresFrom(const py::object& keypoints, const py::object& descriptors,
                      const std::pair<int, int>& image_size, const std::string& descriptor);

/// A read-only array of shape (N,) in the memory of `values`, which `owner` keeps alive.
template <typename Number>
py::array_t<Number> view(const std::vector<Number>& values, const py::object& owner) {
  py::array_t<Number> out(static_cast<py::ssize_t>(values.size()), values.data(), owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

/// The same for points, of shape (N, 2) or (N, 3).
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
