#include "python/arrays.h"

#include <pybind11/eigen.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "python/shared.h"
#include "util/format.h"
#include "util/grey_levels.h"
#include "util/opacity.h"

namespace ktgp_orb::python {
namespace {

constexpr py::ssize_t kLargest = std::numeric_limits<int>::max();
constexpr py::ssize_t kKeypointColumns = 6;

std::string shapeOf(const py::array& array) {
  return py::str(array.attr("shape")).cast<std::string>();
}

bool isWide(const py::array& array) {
  return py::isinstance<py::array_t<std::uint16_t>>(array);
}

/// Throws if `object` is a masked array that hides values, because NumPy would silently drop the
/// mask.
void refuseMasked(const py::handle& object, const std::string& name,
                  const char* expected =
                      "its .data, and what is hidden in a mask of its own: "
                      "(~array.mask).astype(np.uint8)") {
  if (!py::hasattr(object, "filled") || !py::hasattr(object, "mask")) return;
  if (!object.attr("mask").attr("any")().cast<bool>()) return;
  throw py::value_error(name + " is a masked array with hidden values; expected " + expected);
}

/// Returns `object` as an array of uint8 (or uint16, if `may_be_wide`) with contiguous rows. Throws
/// for any other object. Copies the array only if its rows are not contiguous.
py::array bytesOf(const py::object& object, const std::string& name, bool may_be_wide = false) {
  const char* const expected = may_be_wide ? "uint8 or uint16" : "uint8";
  if (!py::isinstance<py::array>(object)) {
    throw py::value_error(name + " is " + py::str(object.attr("__class__")).cast<std::string>() +
                          "; expected a NumPy array of " + expected);
  }
  refuseMasked(object, name);
  auto array = py::reinterpret_borrow<py::array>(object);
  const bool is_wide = may_be_wide && isWide(array);
  if (!is_wide && !py::isinstance<py::array_t<std::uint8_t>>(array)) {
    throw py::value_error(name + " has the type " +
                          py::str(array.attr("dtype")).cast<std::string>() + "; expected " +
                          expected);
  }
  for (py::ssize_t i = 0; i < array.ndim(); ++i) {
    if (array.shape(i) > kLargest) throw py::value_error(name + " is too large");
    if (array.shape(i) == 0 && name != "descriptors") throw py::value_error(name + " is empty");
  }
  const py::ssize_t pixel = array.itemsize() * (array.ndim() == 3 ? array.shape(2) : 1);
  const bool rows_are_dense = array.ndim() >= 2 && array.strides(1) == pixel &&
                              (array.ndim() == 2 || array.strides(2) == array.itemsize()) &&
                              array.strides(0) >= pixel * array.shape(1) &&
                              array.strides(0) % array.itemsize() == 0;
  if (rows_are_dense || array.ndim() < 2) return array;
  if (is_wide) {
    return py::array_t<std::uint16_t, py::array::c_style | py::array::forcecast>::ensure(array);
  }
  return py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>::ensure(array);
}

cv::Mat matrixOf(const py::array& array, int type) {
  const auto rows = static_cast<int>(array.shape(0));
  const auto columns = static_cast<int>(array.shape(1));
  if (rows == 0 || columns == 0) return {};
  // The cast is safe: cv::Mat has no constructor for const pixels, but we only read them.
  auto* const pixels = static_cast<std::uint8_t*>(const_cast<void*>(array.data()));
  return {rows, columns, type, pixels, static_cast<std::size_t>(array.strides(0))};
}

cv::KeyPoint fromCv(const py::handle& keypoint) {
  try {
    const auto point = keypoint.attr("pt").cast<std::pair<float, float>>();
    return {point.first,
            point.second,
            keypoint.attr("size").cast<float>(),
            keypoint.attr("angle").cast<float>(),
            keypoint.attr("response").cast<float>(),
            keypoint.attr("octave").cast<int>()};
  } catch (const py::error_already_set&) {
    throw py::value_error("keypoints has an entry that is not a cv2.KeyPoint");
  }
}

std::vector<cv::KeyPoint> keypointsFrom(const py::object& object) {
  std::vector<cv::KeyPoint> keypoints;
  if (!py::isinstance<py::array>(object)) {
    for (const py::handle& each : object) keypoints.push_back(fromCv(each));
    return keypoints;
  }
  refuseMasked(object, "keypoints");
  using Array = py::array_t<float, py::array::c_style | py::array::forcecast>;
  const auto array = Array::ensure(object);
  if (!array || array.ndim() != 2 || array.shape(1) != kKeypointColumns) {
    PyErr_Clear();
    throw py::value_error("keypoints has the shape " +
                          shapeOf(py::reinterpret_borrow<py::array>(object)) +
                          "; expected (N, 6): x, y, size, angle, response, octave");
  }
  for (py::ssize_t i = 0; i < array.shape(0); ++i) {
    const float* const row = array.data(i, 0);
    keypoints.emplace_back(row[0], row[1], row[2], row[3], row[4], static_cast<int>(row[5]));
  }
  return keypoints;
}

/// Throws if a keypoint is outside the image, or if its position, size or angle is not finite,
/// because such keypoints lead to wrong homographies.
void requireInside(const Features& features) {
  const cv::Size& size = features.image_size;
  for (std::size_t i = 0; i < features.keypoints.size(); ++i) {
    const cv::KeyPoint& k = features.keypoints[i];
    const bool inside = k.pt.x >= -0.5F && k.pt.x <= static_cast<float>(size.width) - 0.5F &&
                        k.pt.y >= -0.5F && k.pt.y <= static_cast<float>(size.height) - 0.5F;
    if (inside && std::isfinite(k.size) && std::isfinite(k.angle)) continue;
    throw py::value_error("keypoint " + std::to_string(i) + " is at (" + std::to_string(k.pt.x) +
                          ", " + std::to_string(k.pt.y) + "), size " + std::to_string(k.size) +
                          ", angle " + std::to_string(k.angle) +
                          "; expected finite numbers, and a position in the image of " +
                          util::text(size) + " px");
  }
}

/// Returns the array as a grey or colour image with 8 or 16 bits per channel; the values do not
/// change.
ImageArray anyImage(const py::object& image, const std::string& name) {
  ImageArray out{bytesOf(image, name, true), {}};
  const py::array& array = out.owner;
  const py::ssize_t channels = array.ndim() == 3 ? array.shape(2) : 1;
  if ((array.ndim() != 2 && array.ndim() != 3) ||
      (channels != 1 && channels != 3 && channels != 4)) {
    throw py::value_error(name + " has the shape " + shapeOf(array) +
                          "; expected (height, width), (height, width, 3) or (height, width, 4)");
  }
  const int depth = isWide(array) ? CV_16U : CV_8U;
  out.pixels = matrixOf(array, CV_MAKETYPE(depth, static_cast<int>(channels)));
  return out;
}

/// Converts the colours of `pixels` with the OpenCV code `with_alpha` if there is an alpha channel,
/// otherwise with `without`. Removes alpha, and fills the pixels that alpha hides.
void convertColour(int with_alpha, int without, cv::Mat& pixels) {
  const cv::Mat given = std::exchange(pixels, cv::Mat());
  cv::cvtColor(given, pixels, given.channels() == 4 ? with_alpha : without);
  util::fillHidden(util::visiblePart(given), pixels);
}

}  // namespace

ImageArray imageArray(const py::object& image, const std::string& name) {
  ImageArray out = anyImage(image, name);
  cv::Mat& pixels = out.pixels;
  if (pixels.channels() == 1) return greyImage(image, name);
  if (pixels.type() == CV_8UC3) return out;
  const WithoutGil others_may_run;
  if (pixels.channels() == 4) convertColour(cv::COLOR_BGRA2BGR, cv::COLOR_BGRA2BGR, pixels);
  if (pixels.depth() == CV_16U) {
    const cv::Mat wide = std::exchange(pixels, cv::Mat());
    wide.convertTo(pixels, CV_8U, 1.0 / 257.0);
  }
  return out;
}

ImageArray greyImage(const py::object& image, const std::string& name) {
  ImageArray out = anyImage(image, name);
  cv::Mat& pixels = out.pixels;
  if (pixels.type() == CV_8UC1) return out;
  const WithoutGil others_may_run;
  if (pixels.channels() > 1) convertColour(cv::COLOR_BGRA2GRAY, cv::COLOR_BGR2GRAY, pixels);
  if (pixels.depth() == CV_16U) pixels = util::stretchTo8Bit(pixels);
  return out;
}

ImageArray maskImage(const py::object& mask) {
  if (mask.is_none()) return {};
  ImageArray grey{bytesOf(mask, "mask"), {}};
  if (grey.owner.ndim() != 2) {
    throw py::value_error("mask has the shape " + shapeOf(grey.owner) +
                          "; expected (height, width)");
  }
  grey.pixels = matrixOf(grey.owner, CV_8UC1);
  const int seen = cv::countNonZero(grey.pixels);
  const bool hides_nothing = seen == static_cast<int>(grey.pixels.total());
  const char* const trouble = seen == 0       ? "mask hides the whole image: 0 hides"
                              : hides_nothing ? "mask hides nothing: only 0 hides"
                                              : nullptr;
  if (trouble != nullptr && PyErr_WarnEx(PyExc_UserWarning, trouble, 1) != 0) {
    throw py::error_already_set();
  }
  return grey;
}

template <typename Numbers>
Numbers numbersFrom(const py::object& numbers, const std::string& name) {
  constexpr bool kIsVector = Numbers::ColsAtCompileTime == 1;
  const std::string rows = std::to_string(Numbers::RowsAtCompileTime);
  refuseMasked(numbers, name, "all of its numbers");
  py::detail::make_caster<Numbers> caster;
  if (!caster.load(numbers, true)) {
    throw py::value_error(name + " is no " + (kIsVector ? "vector" : "matrix") +
                          " of numbers; expected an array of the shape (" + rows + "," +
                          (kIsVector ? "" : " " + rows) + ")");
  }
  return py::detail::cast_op<const Numbers&>(caster);
}

template Eigen::Vector3d numbersFrom(const py::object& numbers, const std::string& name);
template Eigen::Matrix3d numbersFrom(const py::object& numbers, const std::string& name);
template Eigen::Matrix4d numbersFrom(const py::object& numbers, const std::string& name);

std::vector<double> listFrom(const py::object& numbers, const std::string& name) {
  refuseMasked(numbers, name, "all of its numbers");
  using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
  const auto array = Array::ensure(numbers);
  if (!array) {
    PyErr_Clear();
    throw py::value_error(name + " is no vector of numbers; expected an array of the shape (N,)");
  }
  if (array.ndim() != 1) {
    throw py::value_error(name + " has the shape " + shapeOf(array) + "; expected (N,)");
  }
  return {array.data(), array.data() + array.size()};
}

std::optional<Eigen::Matrix3d> cameraMatrix(const py::object& matrix, const std::string& name) {
  if (matrix.is_none()) return std::nullopt;
  return numbersFrom<Eigen::Matrix3d>(matrix, name);
}

py::array_t<float> keypointArray(const Features& features) {
  py::array_t<float> out({static_cast<py::ssize_t>(features.size()), kKeypointColumns});
  float* row = out.mutable_data();
  for (const cv::KeyPoint& keypoint : features.keypoints) {
    for (const float value : {keypoint.pt.x, keypoint.pt.y, keypoint.size, keypoint.angle,
                              keypoint.response, static_cast<float>(keypoint.octave)}) {
      *row++ = value;
    }
  }
  return out;
}

py::array_t<std::uint8_t> descriptorArray(const Features& features, const py::object& owner) {
  const cv::Mat& rows = features.descriptors;
  py::array_t<std::uint8_t> out(
      {static_cast<py::ssize_t>(rows.rows), static_cast<py::ssize_t>(kDescriptorBytes)},
      {static_cast<py::ssize_t>(rows.step[0]), py::ssize_t{1}}, rows.data, owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

py::list cvKeypoints(const Features& features) {
  const py::object type = py::module::import("cv2").attr("KeyPoint");
  py::list out;
  for (const cv::KeyPoint& k : features.keypoints) {
    out.append(type(k.pt.x, k.pt.y, k.size, k.angle, k.response, k.octave, k.class_id));
  }
  return out;
}

Features featuresFrom(const py::object& keypoints, const py::object& descriptors,
                      const std::pair<int, int>& image_size, const std::string& descriptor) {
  Features features;
  if (descriptor != "orb" && descriptor != "teblid") {
    throw py::value_error("descriptor is " + descriptor + "; expected orb or teblid");
  }
  features.descriptor = descriptor == "orb" ? DescriptorKind::orb : DescriptorKind::teblid;
  features.image_size = cv::Size(image_size.first, image_size.second);
  features.keypoints = keypointsFrom(keypoints);
  const py::array bytes = bytesOf(descriptors, "descriptors");
  if (bytes.ndim() != 2) {
    throw py::value_error("descriptors has the shape " + shapeOf(bytes) + "; expected (N, 32)");
  }
  features.descriptors = matrixOf(bytes, CV_8UC1).clone();
  requireInside(features);
  requireValid(features, "features");
  return features;
}

}  // namespace ktgp_orb::python
