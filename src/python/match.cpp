#include "python/match.h"

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string_view>
#include <tuple>

#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/pair_matcher.h"
#include "parameters/options.h"
#include "python/arrays.h"
#include "python/options.h"
#include "python/shared.h"
#include "two_view/cameras.h"
#include "two_view/fields.h"
#include "util/pool.h"

namespace ktgp_orb::python {
namespace {

template <typename Value>
auto viewOf(std::vector<Value> Match::*member) {
  return [member](const py::object& self) { return view(self.cast<const Match&>().*member, self); };
}

template <typename Value>
auto answerField(Value UncertainHomography::*field) {
  return [field](const Match& match) -> const Value& { return match.answer.*field; };
}

py::list stagesOf(const Match& match) {
  py::list out;
  for (const Match::Stage& stage : match.stages) {
    py::dict each;
    each["name"] = stage.name;
    each["input"] = stage.input;
    each["output"] = stage.output;
    each["milliseconds"] = stage.milliseconds;
    out.append(each);
  }
  return out;
}

/// Makes the getter of a Python property that returns `field` of the most probable motion, or None
/// if there is no motion.
template <typename Value>
auto motionField(Value Motion::*field) {
  return [field](const Match& match) {
    return match.motion ? py::cast((*match.motion).*field) : py::object(py::none());
  };
}

std::optional<Motion> motionFrom(Geometry geometry, const RelativePose& pose,
                                 const Covariance6& covariance) {
  Motion motion{toString(geometry), pose.rotation, pose.translation, std::nullopt};
  if (covariance.allFinite()) motion.covariance = covariance;
  return motion;
}

std::string textOf(const Match& match) {
  if (match.status != "ok") return "<ktgp_orb_core.Match: " + match.status + ">";
  return "<ktgp_orb_core.Match: ok, " + match.geometry + ", " + std::to_string(match.inlier_count) +
         " inliers, found by " + match.found_by + ">";
}

/// Makes the hints for the matcher from the arguments K and target_K. Throws std::invalid_argument
/// if a K is given although options.geometry is homography, which does not use K.
MatchHints hintsOf(const MatcherOptions& options, const py::object& camera,
                   const py::object& target_camera) {
  MatchHints hints;
  hints.reference_camera = cameraMatrix(camera, "K");
  hints.target_camera = cameraMatrix(target_camera, "target_K");
  const bool is_given = hints.reference_camera || hints.target_camera;
  if (is_given && options.geometry == GeometryModel::homography) {
    throw std::invalid_argument(
        "K is given, but geometry is homography, which needs none; expected preset=\"slam\", or "
        "geometry=\"auto\" or \"epipolar\"");
  }
  return hints;
}

TwoViewInput inputOf(const MatchHints& hints) {
  TwoViewInput input;
  input.reference_camera = hints.reference_camera;
  input.target_camera = hints.target_camera;
  return input;
}

std::shared_ptr<Match> matchImages(const py::object& reference, const py::object& target,
                                   const py::object& preset, const py::object& camera,
                                   const py::object& target_camera, const py::kwargs& changes) {
  const PipelineOptions options = pipelineOptions(parametersFrom({preset, changes}, Scope::pair));
  const bool photo = py::str(preset).equal(py::str("photo"));
  const bool depth = options.matcher.geometry != GeometryModel::homography;
  const bool by_area = (photo || depth) && !changes.contains("features");
  const ImageArray first = greyImage(reference, "reference");
  const ImageArray second = greyImage(target, "target");
  const MatchHints hints = hintsOf(options.matcher, camera, target_camera);
  const WithoutGil others_may_run;
  const PairMatch pair =
      matchPair(first.pixels, second.pixels, {options.orb, options.matcher, by_area}, hints);
  return std::make_shared<Match>(pair.match, pair.reference, pair.target, inputOf(hints));
}

/// An extractor that several Python threads may call; their calls run one after the other.
class Extractor {
 public:
  explicit Extractor(const Settings& made_from)
      : settings(made_from),
        extractor_(pipelineOptions(parametersFrom(made_from, Scope::pair)).orb) {}

  std::shared_ptr<Features> extract(const py::object& image, const py::object& mask) {
    const ImageArray grey = greyImage(image, "image");
    const ImageArray where = maskImage(mask);
    return extractor_.use([&](OrbExtractor& extractor) {
      auto features = made_.take();
      extractor.extract(grey.pixels, where.pixels, *features);
      return features;
    });
  }

  const Settings settings;

 private:
  Shared<OrbExtractor> extractor_;
  // A pool, so that memory is reused: allocating new images for each frame would take 2 % of the
  // extraction time.
  util::Pool<Features> made_{4, [](Features&) {}};
};

/// A matcher that several Python threads may call; their calls run one after the other.
class Matcher {
 public:
  explicit Matcher(const Settings& made_from)
      : settings(made_from),
        options_(pipelineOptions(parametersFrom(made_from, Scope::pair)).matcher),
        matcher_(options_) {}

  std::shared_ptr<Match> match(const Features& reference, const Features& target,
                               const py::object& camera, const py::object& target_camera) {
    const MatchHints hints = hintsOf(options_, camera, target_camera);
    return matcher_.use([&](KtgpMatcher& matcher) {
      matcher.match(reference, target, hints, result_);
      return std::make_shared<Match>(result_, reference, target, inputOf(hints));
    });
  }

  const Settings settings;

 private:
  MatcherOptions options_;
  Shared<KtgpMatcher> matcher_;
  MatchResult result_;  // result of the current call
};

void defineMotion(py::module& module) {
  py::class_<Motion>(module, "Motion", "A motion of the camera between two images.")
      .def_readonly("geometry", &Motion::geometry, "As Match.geometry, by this motion.")
      .def_readonly("rotation", &Motion::rotation, "(3, 3) float64: as Match.rotation.")
      .def_readonly("translation", &Motion::translation, "(3,) float64: as Match.translation.")
      .def_readonly("covariance", &Motion::covariance,
                    "(6, 6) float64, of this motion alone: as Match.pose_covariance; or None.")
      .def(py::pickle(
          [](const Motion& m) {
            return py::make_tuple(m.geometry, m.rotation, m.translation, m.covariance);
          },
          [](const py::tuple& state) {
            return Motion{state[0].cast<std::string>(), state[1].cast<Eigen::Matrix3d>(),
                          state[2].cast<Eigen::Vector3d>(),
                          state[3].cast<std::optional<Covariance6>>()};
          }));
}

using MatchClass = py::class_<Match, std::shared_ptr<Match>>;

/// Defines the properties of the two-view geometry.
void defineGeometry(MatchClass& match) {
  two_view::visitNumbers([&](const two_view::NumberField& field) {
    match.def_property_readonly(
        field.name, [name = std::string(field.name)](const Match& m) { return m.numbers.at(name); },
        field.text);
  });
  match
      .def_readonly(
          "geometry", &Match::geometry,
          "What explains the matches: \"plane\", \"rotation\", \"epipolar\" (a scene "
          "with depth) or \"none\". rotation and epipolar need geometry=\"auto\", as in "
          "preset \"slam\".\nepipolar: there is no homography, and the inliers are those of "
          "the epipolar geometry.")
      .def_property_readonly(
          "rotation", motionField(&Motion::rotation),
          "(3, 3) float64: x_target ~ rotation @ x_reference + translation, between "
          "points in the cameras' frames (x right, y down, z forward). None without K.")
      .def_property_readonly("translation", motionField(&Motion::translation),
                             "(3,) float64, of length 1; 0 where the camera only turned. It is the "
                             "old position seen from the new camera. None without K.")
      .def_property_readonly(
          "pose_covariance", motionField(&Motion::covariance),
          "(6, 6) float64: of small changes of the translation, and of small rotations "
          "about the target camera's axes, rad. Of rank 5, since the translation has "
          "length 1; it spans both motions where there is other_motion. None where it is not "
          "known.")
      .def_readonly("other_motion", &Match::other,
                    "Motion: the next likely one, where it is not excluded, or None. Its "
                    "probability is 1 - probability.")
      .def_readonly("doubt", &Match::doubt,
                    "Why other_motion is not excluded, for example \"two_motions_of_a_plane\", or "
                    "why there is no geometry; \"none\": no doubt.")
      .def_readonly("fundamental", &Match::fundamental,
                    "(3, 3) float64, of norm 1: x_target^T F x_reference = 0, px. None where there "
                    "is none.")
      .def_property_readonly("points", viewOf(&Match::points),
                             "(M, 3) float64: points of the scene in the reference camera's frame, "
                             "in units of the distance between the cameras. Empty without K.")
      .def_property_readonly("point_deviations", viewOf(&Match::point_deviations),
                             "(M,) float64: standard deviations of their distances.")
      .def_property_readonly("point_matches", viewOf(&Match::point_matches),
                             "(M,) int32: their rows in the arrays of the matches.");
}

/// Defines the properties that are arrays with a row for each correspondence.
void defineRows(MatchClass& match) {
  match
      .def_property_readonly("stages", stagesOf,
                             "A dict for each stage: name, input, output, milliseconds.")
      .def_property_readonly("reference_points", viewOf(&Match::reference_points),
                             "(N, 2) float64: x, y in the reference image, px.")
      .def_property_readonly("target_points", viewOf(&Match::target_points),
                             "(N, 2) float64: x, y in the target image, px.")
      .def_property_readonly("reference_indices", viewOf(&Match::reference_indices),
                             "(N,) int32: keypoint in the reference.")
      .def_property_readonly("target_indices", viewOf(&Match::target_indices),
                             "(N,) int32: keypoint in the target.")
      .def_property_readonly("distances", viewOf(&Match::distances),
                             "(N,) int32: Hamming distance, 0 to 256.")
      .def_property_readonly(
          "levels", viewOf(&Match::levels),
          "(N,) uint8: the last stage passed. 0 KNN, 1 + TF, 2 + GMS, 3: an inlier of the "
          "geometry, 4 an inlier from guided matching or growth.");
}

void defineMatch(py::module& module) {
  MatchClass match(
      module, "Match",
      "The result for two images. Arrays have a row for each correspondence: first those of the "
      "four stages, in "
      "the order of the target's keypoints, then those that guided matching or the growth added.");
  match
      .def_readonly("status", &Match::status,
                    "\"ok\": the geometry that was asked for was found; or why not.")
      .def_readonly("found_by", &Match::found_by,
                    "\"prosac\", \"growth\", \"two_view\" or \"none\".")
      .def_property_readonly(
          "homography", answerField(&UncertainHomography::homography),
          "(3, 3) float64: reference to target, px; zero where there is none: status is "
          "not ok, or geometry is \"epipolar\".")
      .def_property_readonly(
          "covariance", answerField(&UncertainHomography::covariance),
          "(8, 8) float64: of the first eight entries of the homography, row by row, "
          "with H[2, 2] = 1.")
      .def_property_readonly(
          "shared_covariance", answerField(&UncertainHomography::shared_covariance),
          "(8, 8) float64: the part of the covariance that many matches cannot average out.")
      .def_property_readonly("plane_deviation", answerField(&UncertainHomography::plane_deviation),
                             "How far the scene is from a plane, px; 0: not detectably.")
      .def_readonly("inlier_count", &Match::inlier_count,
                    "Number of matches that agree with the geometry.")
      .def_readonly(
          "rmse", &Match::rmse,
          "Root mean square over the inliers, px, of the reprojection errors; epipolar: of the "
          "Sampson distances.");
  defineGeometry(match);
  defineRows(match);
  match.def("__repr__", textOf)
      .def(py::pickle([](const Match& match) { return stateOf(match); },
                      [](const py::tuple& state) {
                        auto match = std::make_shared<Match>();
                        restore(state, *match);
                        return match;
                      }));
}

/// Returns the state of features for pickle. It includes the images, because the sub-pixel
/// alignment needs them.
py::tuple featuresState(const py::object& self) {
  const auto& features = self.cast<const Features&>();
  py::list images;
  for (const cv::Mat& image : features.images) {
    images.append(py::array_t<std::uint8_t>(
        {static_cast<py::ssize_t>(image.rows), static_cast<py::ssize_t>(image.cols)},
        {static_cast<py::ssize_t>(image.step[0]), py::ssize_t{1}}, image.data));
  }
  return py::make_tuple(keypointArray(features), descriptorArray(features, self),
                        std::make_pair(features.image_size.width, features.image_size.height),
                        toString(features.descriptor), images);
}

std::shared_ptr<Features> featuresRestored(const py::tuple& state) {
  auto features = std::make_shared<Features>(featuresFrom(
      state[0], state[1], state[2].cast<std::pair<int, int>>(), state[3].cast<std::string>()));
  for (const py::handle& image : state[4]) {
    features->images.push_back(
        greyImage(py::reinterpret_borrow<py::object>(image), "image").pixels.clone());
  }
  return features;
}

void defineFeatures(py::module& module) {
  py::class_<Features, std::shared_ptr<Features>>(
      module, "Features", "Keypoints of an image, their descriptors, and the size of the image.")
      .def(py::init([](const py::object& keypoints, const py::object& descriptors,
                       const std::pair<int, int>& image_size, const std::string& descriptor) {
             return std::make_shared<Features>(
                 featuresFrom(keypoints, descriptors, image_size, descriptor));
           }),
           py::arg("keypoints"), py::arg("descriptors"), py::arg("image_size"),
           py::arg("descriptor") = "orb",
           "keypoints: (N, 6) float32 (x, y, size, angle, response, octave) or a list of "
           "cv2.KeyPoint;\ndescriptors: (N, 32) uint8; image_size: (width, height); descriptor: "
           "\"orb\" or \"teblid\".\nWithout the images there is no sub-pixel alignment. Raises "
           "ValueError.")
      .def_property_readonly(
          "keypoints", keypointArray,
          "(N, 6) float32, a copy: x, y, size (px), angle (degrees), response, octave.")
      .def_property_readonly(
          "descriptors",
          [](const py::object& self) {
            return descriptorArray(self.cast<const Features&>(), self);
          },
          "(N, 32) uint8, read-only.")
      .def_property_readonly(
          "image_size",
          [](const Features& features) {
            return py::make_tuple(features.image_size.width, features.image_size.height);
          },
          "(width, height), px.")
      .def_property_readonly(
          "descriptor", [](const Features& features) { return toString(features.descriptor); },
          "\"orb\" or \"teblid\".")
      .def("to_cv", cvKeypoints, "A list of cv2.KeyPoint; imports cv2.")
      .def(py::pickle([](const py::object& self) { return featuresState(self); },
                      [](const py::tuple& state) { return featuresRestored(state); }))
      .def("__len__", &Features::size);
}

}  // namespace

Match::Match(const MatchResult& result, const Features& reference, const Features& target,
             const TwoViewInput& input)
    : status(toString(result.status)),
      found_by(toString(result.found_by)),
      answer(result.answer),
      inlier_count(result.inliers),
      rmse(result.rmse),
      geometry(toString(result.geometry)),
      doubt(toString(result.two_view.view.doubt)) {
  const TwoView& found = result.two_view.view;
  two_view::visitNumbers(
      [&](const two_view::NumberField& field, double value) { numbers[field.name] = value; },
      found);
  if (found.geometry == Geometry::none) numbers["parallax"] = std::nan("");
  if (!found.fundamental.isZero(0.0)) fundamental = found.fundamental;
  if (found.geometry != Geometry::none && two_view::hasPose(found)) {
    motion = motionFrom(found.geometry, found.pose, found.pose_covariance);
    if (found.other) {
      other = motionFrom(found.other->geometry, found.other->pose, found.other->pose_covariance);
    }
  }
  for (const StageResult& stage : result.stages) {
    stages.push_back({toString(stage.id), stage.input, stage.output, stage.milliseconds});
  }
  const auto place = [](const Features& features, std::int32_t index) {
    const cv::Point2f& point = features.keypoints[static_cast<std::size_t>(index)].pt;
    return Eigen::Vector2d(point.x, point.y);
  };
  const std::size_t most = result.correspondences.size() + result.guided.size();
  reference_points.reserve(most);
  target_points.reserve(most);
  for (auto* indices : {&reference_indices, &target_indices, &distances}) indices->reserve(most);
  levels.reserve(most);
  for (const auto* list : {&result.correspondences, &result.guided}) {
    for (const Correspondence& c : *list) {
      if (c.reference_index < 0) continue;
      reference_points.push_back(place(reference, c.reference_index));
      target_points.push_back(place(target, c.target_index));
      reference_indices.push_back(c.reference_index);
      target_indices.push_back(c.target_index);
      distances.push_back(c.distance);
      levels.push_back(static_cast<std::uint8_t>(c.level));
    }
  }
  if (input.reference_camera) addPoints(result, input);
}

void Match::addPoints(const MatchResult& result, const TwoViewInput& input) {
  std::vector<ScenePoint> scene;
  triangulate(result.two_view, input, scene);
  // For each correspondence: its row in the Python arrays, or -1 if it has none there because its
  // target keypoint has no nearest neighbour.
  std::vector<std::int32_t> rows;
  rows.reserve(result.correspondences.size());
  std::int32_t row = 0;
  for (const Correspondence& c : result.correspondences) {
    rows.push_back(c.reference_index < 0 ? -1 : row++);
  }
  for (const ScenePoint& point : scene) {
    points.push_back(point.position);
    point_deviations.push_back(two_view::distanceDeviation(point));
    point_matches.push_back(rows[result.two_view.match[point.pair]]);
  }
}

namespace {

/// pickled() converts a field for pickle, and unpickle() converts it back. An array is stored as
/// the bytes of its memory.
template <typename Value>
const Value& pickled(const Value& value) {
  return value;
}
template <typename Value>
py::bytes pickled(const std::vector<Value>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)};
}

template <typename Value>
void unpickle(const py::handle& state, Value& value) {
  value = state.cast<Value>();
}
template <typename Value>
void unpickle(const py::handle& bytes, std::vector<Value>& values) {
  const auto memory = bytes.cast<std::string_view>();
  values.resize(memory.size() / sizeof(Value));
  if (!values.empty())
    std::memcpy(static_cast<void*>(values.data()), memory.data(), values.size() * sizeof(Value));
}

/// Returns references to all fields that pickle stores, except the stages, which follow these
/// fields in the pickled state.
template <typename AnyMatch>
auto fieldsOf(AnyMatch& m) {
  return std::tie(m.status, m.found_by, m.answer.homography, m.answer.covariance,
                  m.answer.shared_covariance, m.answer.plane_deviation, m.inlier_count, m.rmse,
                  m.geometry, m.doubt, m.motion, m.other, m.fundamental, m.numbers, m.points,
                  m.point_deviations, m.point_matches, m.reference_points, m.target_points,
                  m.reference_indices, m.target_indices, m.distances, m.levels);
}

}  // namespace

py::tuple stateOf(const Match& match) {
  return std::apply(
      [&](const auto&... field) { return py::make_tuple(pickled(field)..., stagesOf(match)); },
      fieldsOf(match));
}

void restore(const py::tuple& state, Match& match) {
  std::size_t next = 0;
  std::apply([&](auto&... field) { (unpickle(state[next++], field), ...); }, fieldsOf(match));
  for (const auto& stage : state[next]) {
    match.stages.push_back({stage["name"].cast<std::string>(), stage["input"].cast<std::size_t>(),
                            stage["output"].cast<std::size_t>(),
                            stage["milliseconds"].cast<double>()});
  }
}

void definePairs(py::module& module) {
  defineFeatures(module);
  defineMotion(module);
  defineMatch(module);
  py::class_<Extractor> extractor(module, "Extractor",
                                  "Finds keypoints and descriptors. Threads may share an object.");
  defineSettings(extractor, "ktgp",
                 "Keywords are the parameters of doc/parameters.md, e.g. features=1000. Raises "
                 "ValueError.");
  extractor.def("extract", &Extractor::extract, py::arg("image"), py::arg("mask") = py::none(),
                "image: (height, width) uint8, grey and not copied where its rows are dense, or "
                "(height, width, 3 or 4),\nblue, green, red, alpha; or uint16; mask: (height, "
                "width) uint8, keypoints are found where it is not 0. Returns Features.\nRaises "
                "ValueError.");
  py::class_<Matcher> matcher(module, "Matcher",
                              "Matches the features of two images. Threads may share an object.");
  defineSettings(matcher, "ktgp",
                 "Keywords are the parameters of doc/parameters.md, e.g. T_w=0.8. Raises "
                 "ValueError.");
  matcher.def("match", &Matcher::match, py::arg("reference"), py::arg("target"),
              py::arg("K") = py::none(), py::arg("target_K") = py::none(),
              "reference, target: Features. K: as in match(). Returns Match. Raises ValueError for "
              "descriptors of two kinds.");
  module.def(
      "match", matchImages, py::arg("reference"), py::arg("target"), py::arg("preset") = "photo",
      py::arg("K") = py::none(), py::arg("target_K") = py::none(),
      "Matches two images: (height, width) of uint8 or uint16, or (height, width, 3 or 4) in the "
      "order blue, green, red, alpha.\n\npreset: \"photo\" finds most, as ktgp_match does; "
      "\"ktgp\", \"robust\", \"slam\", "
      "\"teblid\" or \"video\"; keywords are the parameters of doc/parameters.md,\ne.g. T_w=0.8. "
      "K: (3, 3), the camera's matrix in px for images without distortion; with preset \"slam\" it "
      "gives the camera's motion.\ntarget_K: that of the target where it differs. Returns Match. "
      "Raises ValueError.");
}

}  // namespace ktgp_orb::python
