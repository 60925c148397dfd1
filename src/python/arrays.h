#pragma once

#include <pybind11/numpy.h>

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ktgp_orb/features.h"

namespace ktgp_orb::python {

namespace py = pybind11;

/// An image. `pixels` usually points into the memory of the NumPy array `owner`, so keep the two
/// together.
struct ImageArray {
  py::array owner;
  cv::Mat pixels;
};

/// Converts an array of shape (height, width) to CV_8UC1, or (height, width, 3) to CV_8UC3. The
/// order of the colours is blue, green, red, as in files that OpenCV reads. An array of uint8 with
/// contiguous rows is not copied. Alpha is removed, and the pixels that it hides are replaced (see
/// util::fillHidden). uint16 grey images are stretched to 8 bits by util::stretchTo8Bit, as the
/// command-line programs do; uint16 colour images are scaled to 8 bits without stretching. Throws
/// py::value_error, which names the image, its type or shape, and what is expected. Also throws for
/// a masked array that hides values.
ImageArray imageArray(const py::object& image, const std::string& name);

/// Converts an array to CV_8UC1. Colours are converted to grey; uint16 is then stretched to 8 bits.
ImageArray greyImage(const py::object& image, const std::string& name);

/// Returns the mask as CV_8UC1, or an empty matrix if `mask` is None.
ImageArray maskImage(const py::object& mask);

/// Returns the vector or the square matrix that a Python program gives as the argument `name`.
/// Throws py::value_error, which names the argument and what is expected. Also throws for a masked
/// array that hides values. Numbers: Eigen::Vector3d, Matrix3d or Matrix4d.
template <typename Numbers>
Numbers numbersFrom(const py::object& numbers, const std::string& name);

/// Returns a vector of any length, in the same way.
std::vector<double> listFrom(const py::object& numbers, const std::string& name);

/// Returns the camera matrix K like numbersFrom(), or nothing for None.
std::optional<Eigen::Matrix3d> cameraMatrix(const py::object& matrix, const std::string& name);

/// Returns the keypoints as an array (N, 6) of float32: x, y, size, angle, response, octave.
py::array_t<float> keypointArray(const Features& features);
/// Returns the descriptors as a read-only array (N, 32) of uint8. The array uses the memory of
/// `features`, which `owner` keeps alive.
py::array_t<std::uint8_t> descriptorArray(const Features& features, const py::object& owner);
/// Returns the keypoints as a list of cv2.KeyPoint. Imports cv2.
py::list cvKeypoints(const Features& features);

/// Makes Features from keypoints and their descriptors. `keypoints`: an array like the result of
/// keypointArray(), or a list of cv2.KeyPoint. `image_size`: (width, height). Throws
/// py::value_error.
Features featuresFrom(const py::object& keypoints, const py::object& descriptors,
                      const std::pair<int, int>& image_size, const std::string& descriptor);

/// Returns a read-only array of shape (N,) that uses the memory of `values`, which `owner` keeps
/// alive.
template <typename Number>
py::array_t<Number> view(const std::vector<Number>& values, const py::object& owner) {
  py::array_t<Number> out(static_cast<py::ssize_t>(values.size()), values.data(), owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

/// Returns a read-only array of shape (N, 2) or (N, 3) that uses the memory of `points`, which
/// `owner` keeps alive.
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
