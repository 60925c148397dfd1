// Python classes that use the matches: flat targets, mosaic, stabilizer, motion above the ground.
#include <pybind11/stl.h>

#include <cmath>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "ktgp_orb/ground_motion.h"
#include "ktgp_orb/mosaic.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/stabilizer.h"
#include "ktgp_orb/target_finder.h"
#include "ktgp_orb/target_pose.h"
#include "python/arrays.h"
#include "python/match.h"
#include "python/shared.h"
#include "util/camera_check.h"
#include "util/format.h"
#include "util/options_check.h"

namespace ktgp_orb::python {
namespace {

/// The argument `camera`, which must be given.
Eigen::Matrix3d requiredCamera(const py::object& matrix) {
  const std::optional<Eigen::Matrix3d> camera = cameraMatrix(matrix, "camera");
  if (!camera) throw py::value_error("camera is None; expected an array of the shape (3, 3)");
  return *camera;
}

/// Makes the getter of a Python property that calls `get` on a shared object.
template <typename Object, typename Value>
auto getting(Value (Object::*get)() const) {
  return [get](Shared<Object>& shared) {
    return shared.use([get](const Object& object) { return (object.*get)(); });
  };
}

using Homography = std::optional<Eigen::Matrix3d>;

Homography homographyOf(const FrameMatch& frame) {
  return frame.hasHomography() ? Homography(frame.answer.homography) : std::nullopt;
}

using Targets = Shared<TargetFinder>;

std::string addTarget(Targets& targets, const std::string& id, const py::object& images,
                      double width) {
  Target target{id, {}, width, ""};
  const bool several = py::isinstance<py::list>(images) || py::isinstance<py::tuple>(images);
  const py::list list = several ? py::list(images) : py::list(py::make_tuple(images));
  for (const py::handle& image : list) {
    target.images.push_back(
        greyImage(py::reinterpret_borrow<py::object>(image), "image").pixels.clone());
  }
  return targets.use([&](TargetFinder& finder) {
    finder.add(target);
    return finder.ambiguity(id);
  });
}

/// A detected target with its poses; it has poses only if the camera matrix K is known.
struct PosedTarget : DetectedTarget {
  std::vector<PlanarPose> poses;
};

std::vector<PosedTarget> findTargets(Targets& targets, const py::object& image,
                                     const py::object& matrix) {
  const ImageArray grey = greyImage(image, "image");
  const std::optional<Eigen::Matrix3d> camera = cameraMatrix(matrix, "K");
  if (camera) {
    util::requireK("K", *camera, grey.pixels.size());
    util::requirePrincipalPoint("K", *camera, grey.pixels.size());
  }
  return targets.use([&](TargetFinder& finder) {
    const std::vector<DetectedTarget>& detections = finder.find(grey.pixels).detections;
    std::vector<PosedTarget> found;
    found.reserve(detections.size());
    for (const DetectedTarget& target : detections) {
      found.push_back({target, {}});
      if (!camera || target.status != Status::ok) continue;
      found.back().poses =
          planarPoses(target.homography.homography, target.homography.covariance, *camera,
                      target.image_size, target.width > 0.0 ? target.width : 1.0)
              .poses;
    }
    return found;
  });
}

void definePlanarPose(py::module& module) {
  py::class_<PlanarPose>(module, "TargetPose", "Where a flat target is in the camera's frame.")
      .def_property_readonly(
          "matrix",
          [](const PlanarPose& p) { return Eigen::Matrix4d(p.target_to_camera.matrix()); },
          "(4, 4) float64: target to camera (x right, y down, z forward). The origin of the target "
          "is its middle; m where its width is known, else widths of the target.")
      .def_readonly("covariance", &PlanarPose::covariance,
                    "(6, 6) float64: of x, y, z, and of small rotations about the camera's axes, "
                    "rad.")
      .def_readonly("share", &PlanarPose::share, "Probability of this pose, 0 to 1.");
}

void defineDetectedTarget(py::module& module) {
  py::class_<PosedTarget>(module, "DetectedTarget", "A flat target in an image.")
      .def_readonly("id", &PosedTarget::id)
      .def_readonly("instance", &PosedTarget::instance, "From 0; of several copies in an image.")
      .def_property_readonly(
          "status", [](const PosedTarget& d) { return toString(d.status); },
          "\"ok\", or \"model_rejected\": another target explains the place better, or it is "
          "uncertain.")
      .def_readonly("uncertain", &PosedTarget::uncertain,
                    "It was found, but a corner has a standard deviation of more than 5 px.")
      .def_property_readonly(
          "corners",
          [](const PosedTarget& d) {
            Eigen::Matrix<double, 4, 2, Eigen::RowMajor> corners;
            for (int i = 0; i < 4; ++i) corners.row(i) = d.corners[static_cast<std::size_t>(i)];
            return corners;
          },
          "(4, 2) float64: upper left, upper right, lower right, lower left, px.")
      .def_property_readonly(
          "homography", [](const PosedTarget& d) { return d.homography.homography; },
          "(3, 3) float64: image of the target to this image, px.")
      .def_property_readonly(
          "covariance", [](const PosedTarget& d) { return d.homography.covariance; },
          "(8, 8) float64: see Match.covariance.")
      .def_readonly("inliers", &PosedTarget::inliers)
      .def_readonly("log_false_alarms", &PosedTarget::log_false_alarms,
                    "log10 of the expected number of false alarms.")
      .def_readonly("width", &PosedTarget::width, "As given to add, m.")
      .def_readonly("ambiguity", &PosedTarget::ambiguity,
                    "How it looks like itself in another pose, such as \"turned by 180 degrees\": "
                    "then this pose is one of several. Empty: it does not.")
      .def_readonly("poses", &PosedTarget::poses,
                    "A list of TargetPose, the likeliest first: two where the view is nearly "
                    "frontal. Empty without K.");
}

void defineTargets(py::module& module) {
  definePlanarPose(module);
  defineDetectedTarget(module);
  const TargetFinderOptions usual;
  py::class_<Targets>(module, "Targets",
                      "Finds many known flat pictures in images. Threads may share an object.")
      .def(
          py::init([](int features, int views, double smallest_side, int max_instances) {
            TargetFinderOptions options;
            options.features = features;
            options.views = views;
            options.smallest_side = smallest_side;
            options.max_instances = max_instances;
            return std::make_unique<Targets>(options);
          }),
          py::arg("features") = usual.features, py::arg("views") = usual.views,
          py::arg("smallest_side") = usual.smallest_side,
          py::arg("max_instances") = usual.max_instances,
          "features: keypoints of a target's image; views: 1, or 5 with tilted ones;\n"
          "smallest_side: of the smallest targets wanted, px; max_instances: copies of one target. "
          "Raises ValueError.")
      .def("add", addTarget, py::arg("id"), py::arg("images"), py::arg("width") = 0.0,
           "images: an image of the whole target and nothing else, or a list of them; width in m, "
           "0: not known.\nReturns DetectedTarget.ambiguity. Raises ValueError with the reason.")
      .def(
          "remove",
          [](Targets& targets, const std::string& id) {
            return targets.use([&](TargetFinder& finder) { return finder.remove(id); });
          },
          py::arg("id"), "False if there is no such target.")
      .def_property_readonly("ids", getting(&TargetFinder::ids),
                             "In the order in which they were added.")
      .def("find", findTargets, py::arg("image"), py::arg("K") = py::none(),
           "The targets in an image, a list of DetectedTarget. Images of one camera in their order "
           "are followed.\nK: (3, 3), the camera's matrix in px for images without distortion, for "
           "the poses. Raises ValueError.");
}

using SharedPose = Shared<TargetPose>;
using FoundPose = std::tuple<Eigen::Matrix4d, Eigen::Matrix<double, 6, 6>, double>;

std::vector<FoundPose> findPoses(SharedPose& shared, const PosedTarget& target,
                                 const py::object& matrix, std::pair<int, int> size,
                                 const py::object& distortion, std::optional<double> given) {
  const Eigen::Matrix3d camera = requiredCamera(matrix);
  const cv::Size image(size.first, size.second);
  if (image.width < 1 || image.height < 1) {
    throw py::value_error("size is " + std::to_string(size.first) + ", " +
                          std::to_string(size.second) + "; expected the image's width and height");
  }
  util::requireK("camera", camera, image);
  util::requirePrincipalPoint("camera", camera, image);
  const double seconds = given.value_or(0.0);
  constexpr double kLatest = 9e9;  // s; a stamp is an int64 of nanoseconds
  util::requireInRange("seconds", seconds, -kLatest, kLatest);
  LensCalibration calibration;
  calibration.image_size = image;
  for (int i = 0; i < 9; ++i) calibration.camera(i / 3, i % 3) = camera(i / 3, i % 3);
  calibration.rectified_camera = calibration.camera;
  calibration.distortion = listFrom(distortion, "distortion");
  std::optional<Lens> lens;
  if (!calibration.distortion.empty()) lens.emplace(calibration);
  const auto stamp = static_cast<std::int64_t>(std::llround(1e9 * seconds));
  const PlanarPoses found = shared.use([&](TargetPose& pose) {
    if (!given && pose.readoutTime() != 0.0 && pose.readoutTime() != -1.0) {
      throw py::value_error(
          "seconds is missing; expected the time of the image, because readout_time is given");
    }
    return pose.find(target, camera, lens ? &*lens : nullptr, stamp, image.height);
  });
  std::vector<FoundPose> poses;
  poses.reserve(found.poses.size());
  for (const PlanarPose& p : found.poses)
    poses.emplace_back(p.target_to_camera.matrix(), p.covariance, p.share);
  return poses;
}

void defineTargetPose(py::module& module) {
  py::class_<SharedPose>(module, "TargetPoses",
                         "Poses of found targets in front of a camera with a lens and a shutter.")
      .def(py::init<double>(), py::arg("readout_time") = -1.0,
           "readout_time: s from the first row of an image to the last, -0.2 to 0.2; below 0: the "
           "last row is exposed first;\n0: a global shutter; -1: not known. Raises ValueError.")
      .def("find", findPoses, py::arg("target"), py::arg("camera"), py::arg("size"),
           py::arg("distortion") = py::tuple(), py::arg("seconds") = py::none(),
           "The poses of a DetectedTarget with a width: none, one or two, the likelier one first. "
           "camera: (3, 3), K in px;\nsize: width and height of the image; distortion: 4, 5, 8, 12 "
           "or 14 coefficients in OpenCV's order; seconds: time of the image; without "
           "it, the shutter is ignored, even if readout_time is not known.\nEach is "
           "(target to "
           "camera, (4, 4), m; (6, 6) covariance of x, y, z and rotations about the camera's axes; "
           "likelihood against the other one, 0 to 1).\nRaises ValueError.");
}

using SharedMosaic = Shared<Mosaic>;

std::string placeFrame(SharedMosaic& shared, const py::object& image, const FrameMatch& frame) {
  const ImageArray pixels = imageArray(image, "image");
  if (pixels.pixels.size() != frame.image_size) {
    throw py::value_error("image is " + util::text(pixels.pixels.size()) + ", and the frame " +
                          util::text(frame.image_size) + "; expected the image that was matched");
  }
  return shared.use([&](Mosaic& mosaic) {
    mosaic.follow(frame.stamp, frame.reference_stamp, homographyOf(frame));
    return toString(mosaic.place(frame.stamp, pixels.pixels));
  });
}

py::array mapOf(SharedMosaic& shared) {
  const cv::Mat map = shared.use([](Mosaic& mosaic) { return mosaic.image(); });
  return py::array_t<std::uint8_t>({map.rows, map.cols, 4}, map.data);
}

std::tuple<int, int, int, int> areaOf(SharedMosaic& shared) {
  const cv::Rect area = shared.use([](Mosaic& mosaic) {
    mosaic.image();  // draws the newest frame, which may enlarge the area
    return mosaic.area();
  });
  return {area.x, area.y, area.width, area.height};
}

void defineMosaic(py::module& module) {
  const MosaicOptions usual;
  py::class_<SharedMosaic>(
      module, "Mosaic",
      "A picture of a plane, made of the frames of a camera. Threads may share an object.")
      .def(py::init([](double max_megapixels, bool keyframes, bool gain) {
             MosaicOptions options;
             options.max_megapixels = max_megapixels;
             options.keyframes = keyframes;
             options.gain = gain;
             return std::make_unique<SharedMosaic>(options);
           }),
           py::arg("max_megapixels") = usual.max_megapixels, py::arg("keyframes") = usual.keyframes,
           py::arg("gain") = usual.gain, "doc/views.md describes the options. Raises ValueError.")
      .def(
          "add", placeFrame, py::arg("image"), py::arg("frame"),
          "The next image and its FrameMatch. Returns \"drawn\", \"seen\" (hardly moved, or full), "
          "\"new_map\" or \"lost\".")
      .def_property_readonly(
          "image", mapOf,
          "(height, width, 4) uint8, a copy: blue, green, red, and alpha 0 where nothing was seen.")
      .def_property_readonly(
          "area", areaOf,
          "(x, y, width, height), px: pixel (0, 0) of `image` is the place (x, y) of the map, "
          "whose origin is that of its first frame.")
      .def_property_readonly(
          "pose", getting(&Mosaic::pose),
          "(3, 3) float64: maps a place of the map to the last image, px; None where it is lost. A "
          "pixel of `image` is at another place of the map, see `area`.\nIn a panorama, which is "
          "drawn if the camera only turns, `image` is a cylinder, and `pose` maps pixels of its "
          "first frame.")
      .def_property_readonly(
          "plane_deviation", getting(&Mosaic::planeDeviation),
          "How far points are off the map, px; where it is large, the scene is no plane.");
}

using SharedStabilizer = Shared<Stabilizer>;

std::vector<SteadyFrame> addToPath(SharedStabilizer& shared, const FrameMatch& frame) {
  std::vector<SteadyFrame> ready;
  if (frame.repeated) return ready;
  shared.use([&](Stabilizer& stabilizer) {
    stabilizer.add(frame.stamp, frame.reference_stamp, homographyOf(frame), frame.image_size,
                   ready);
  });
  return ready;
}

std::vector<SteadyFrame> flushPath(SharedStabilizer& shared) {
  std::vector<SteadyFrame> ready;
  shared.use([&](Stabilizer& stabilizer) { stabilizer.flush(ready); });
  return ready;
}

void defineStabilizer(py::module& module) {
  py::class_<SteadyFrame>(module, "SteadyFrame", "A frame and its place in the steady picture.")
      .def_property_readonly(
          "seconds", [](const SteadyFrame& f) { return secondsOf(f.stamp); },
          "FrameMatch.seconds of the frame.")
      .def_readonly("warp", &SteadyFrame::warp,
                    "(3, 3) float64: frame to steady picture of the same size, px, as for "
                    "cv2.warpPerspective.")
      .def_readonly("starts_anew", &SteadyFrame::starts_anew,
                    "Not connected to the frame before: a scene cut, for example.");
  const StabilizerOptions usual;
  py::class_<SharedStabilizer>(module, "Stabilizer",
                               "Smooths the path of a camera. Threads may share an object.")
      .def(py::init([](double strength, int lag, double max_crop) {
             return std::make_unique<SharedStabilizer>(StabilizerOptions{strength, lag, max_crop});
           }),
           py::arg("strength") = usual.strength, py::arg("lag") = usual.lag,
           py::arg("max_crop") = usual.max_crop,
           "strength: s, faster motion is removed; lag: later frames to wait for; max_crop: share "
           "that may be\ncut off at each border. Raises ValueError.")
      .def("add", addToPath, py::arg("frame"),
           "The next FrameMatch of a Sequence. Returns the SteadyFrames that are known now.\n"
           "A repeated image is no new frame and is left out.")
      .def("flush", flushPath, "The SteadyFrames that still wait.");
}

using SharedMotion = Shared<GroundMotion>;

GroundEstimate addToMotion(SharedMotion& shared, const FrameMatch& frame, const py::object& camera,
                           const std::optional<std::pair<double, double>>& height,
                           const std::optional<std::pair<py::object, double>>& down,
                           const std::optional<std::pair<py::object, double>>& turn, bool of_imu) {
  if (frame.hasHomography() && frame.reference_size != frame.image_size) {
    throw py::value_error("the homography is from a reference of " +
                          util::text(frame.reference_size) + " to an image of " +
                          util::text(frame.image_size) +
                          "; expected a reference by the same camera: for a map, use Targets");
  }
  if (of_imu && !down) {
    throw py::value_error(
        "of_imu is True, but down is missing; expected the direction to the ground that the Imu "
        "has measured");
  }
  GroundFrame given;
  given.stamp = frame.stamp;
  given.reference_stamp = frame.reference_stamp;
  if (frame.hasHomography()) given.answer = frame.answer;
  given.camera = requiredCamera(camera);
  given.size = frame.image_size;
  if (height) {
    given.height.emplace();
    std::tie(given.height->metres, given.height->deviation) = *height;
  }
  if (down) {
    given.down.emplace();
    given.down->direction = numbersFrom<Eigen::Vector3d>(down->first, "down[0]");
    given.down->deviation = down->second;
    given.down->of_imu = of_imu;
  }
  if (turn) {
    given.turn.emplace();
    given.turn->rotation = numbersFrom<Eigen::Matrix3d>(turn->first, "turn[0]");
    given.turn->deviation = turn->second;
  }
  return shared.use([&](GroundMotion& motion) { return motion.add(given); });
}

void defineImuMounting(py::module& module) {
  py::class_<ImuMounting>(module, "ImuMounting",
                          "How an Imu is mounted and stamped, as the images show it. What the "
                          "motion does not show is 0 with an infinite standard deviation.")
      .def_readonly("rotation", &ImuMounting::rotation,
                    "(3,) float64: from where it is said to be mounted to where it is, about the "
                    "axes of the base, rad.")
      .def_readonly("rotation_deviation", &ImuMounting::rotation_deviation)
      .def_readonly("delay", &ImuMounting::delay, "How late its stamps are, s.")
      .def_readonly("delay_deviation", &ImuMounting::delay_deviation)
      .def_readonly("bias", &ImuMounting::bias,
                    "(3,) float64: of the angular velocity, in the base frame, rad/s.")
      .def_readonly("bias_deviation", &ImuMounting::bias_deviation)
      .def_readonly("scale_error", &ImuMounting::scale_error,
                    "By which share of it the angular velocity is too large.")
      .def_readonly("scale_error_deviation", &ImuMounting::scale_error_deviation)
      .def_property_readonly("trouble", &troubleOf, "What is certainly wrong; empty: nothing.")
      .def("__str__", &describe);
}

void defineGroundEstimate(py::module& module) {
  py::class_<GroundEstimate>(module, "GroundEstimate", "Position and velocity of the base.")
      .def_property_readonly(
          "status", [](const GroundEstimate& e) { return toString(e.status); },
          "\"ok\": pose and twist; \"started\", \"resumed\": a pose alone; else why there is none.")
      .def_property_readonly(
          "pose",
          [](const GroundEstimate& e) {
            return e.hasPose() ? std::make_optional<Eigen::Matrix4d>(e.base_to_odometry.matrix())
                               : std::nullopt;
          },
          "(4, 4) float64: base to odometry frame, m, z up from the ground; None: not known.")
      .def_readonly("pose_covariance", &GroundEstimate::pose_covariance,
                    "(6, 6) float64: x, y, z (m), rotations about the axes (rad).")
      .def_property_readonly(
          "twist",
          [](const GroundEstimate& e) {
            using Vector6 = Eigen::Matrix<double, 6, 1>;
            return e.hasTwist() ? std::make_optional<Vector6>(e.twist) : std::nullopt;
          },
          "(6,) float64: velocity (m/s) and angular velocity (rad/s) in the base frame; None: not "
          "known.")
      .def_readonly("twist_covariance", &GroundEstimate::twist_covariance)
      .def_readonly("height", &GroundEstimate::height, "Of the camera above the ground, m.")
      .def_readonly("readout_time", &GroundEstimate::readout_time,
                    "Of a rolling shutter, as far as the images show it, s.")
      .def_readonly("readout_deviation", &GroundEstimate::readout_deviation,
                    "Standard deviation of readout_time, s.")
      .def_readonly("imu", &GroundEstimate::imu,
                    "ImuMounting; None: the motion has shown nothing yet. Nothing is corrected by "
                    "it.");
}

Pose3 mountingFrom(const py::object& camera_to_base) {
  constexpr double kRounding = 1e-6;
  const auto matrix = numbersFrom<Eigen::Matrix4d>(camera_to_base, "camera_to_base");
  if (!((matrix.row(3) - Eigen::RowVector4d::UnitW()).norm() < kRounding)) {
    throw py::value_error(
        "camera_to_base is not a rotation and a finite translation: its last row is not 0, 0, 0, "
        "1; is it transposed?");
  }
  return Pose3(matrix);
}

void defineGroundMotion(py::module& module) {
  defineImuMounting(module);
  defineGroundEstimate(module);
  const GroundMotionOptions usual;
  py::class_<SharedMotion>(module, "GroundMotion",
                           "Motion in metres of a calibrated camera that looks at flat ground. "
                           "Threads may share an object.")
      .def(py::init([](const py::object& camera_to_base, double ground_slope, double readout_time,
                       double scale_deviation) {
             GroundMotionOptions options;
             options.camera_to_base = mountingFrom(camera_to_base);
             options.ground_slope = ground_slope;
             options.readout_time = readout_time;
             options.scale_deviation = scale_deviation;
             return std::make_unique<SharedMotion>(options);
           }),
           py::arg("camera_to_base") = Eigen::Matrix4d(Eigen::Matrix4d::Identity()),
           py::arg("ground_slope") = usual.ground_slope,
           py::arg("readout_time") = usual.readout_time,
           py::arg("scale_deviation") = usual.scale_deviation,
           "camera_to_base: (4, 4), from the camera's frame (x right, y down, z forward);\n"
           "readout_time: s from the first row of an image to the last; 0: a global shutter; -1: "
           "not known,\nit is estimated; doc/motion.md describes the others. Raises ValueError.")
      .def(
          "add", addToMotion, py::arg("frame"), py::arg("camera"), py::arg("height") = py::none(),
          py::arg("down") = py::none(), py::arg("turn") = py::none(), py::arg("of_imu") = false,
          "The next FrameMatch of a Sequence; camera: (3, 3), K in px; height: (m, deviation in m) "
          "above the ground;\ndown: (direction to the ground in the camera's frame, length 1; "
          "deviation in rad); turn: (rotation since the frame before, (3, 3), from the camera now "
          "to the camera then;\ndeviation in rad), of a gyroscope; of_imu: down is measured by an "
          "Imu. Returns GroundEstimate.\nRaises ValueError.");
}

}  // namespace

void defineConsumers(py::module& module) {
  defineTargets(module);
  defineTargetPose(module);
  defineMosaic(module);
  defineStabilizer(module);
  defineGroundMotion(module);
}

}  // namespace ktgp_orb::python
