#include "python/match.h"

#include <cstring>
#include <string_view>
#include <type_traits>

#include "parameters/options.h"
#include "python/arrays.h"
#include "python/options.h"

namespace ktgp_orb::python {
namespace {

/// A read-only array of shape (N,) in the memory of `values`, which `owner` keeps alive.
template <typename Number>
py::array_t<Number> view(const std::vector<Number>& values, const py::object& owner) {
  py::array_t<Number> out(static_cast<py::ssize_t>(values.size()), values.data(), owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

/// The same for points, of shape (N, 2).
py::array_t<double> view(const std::vector<Eigen::Vector2d>& points, const py::object& owner) {
  const auto* const numbers = reinterpret_cast<const double*>(points.data());
  py::array_t<double> out({static_cast<py::ssize_t>(points.size()), py::ssize_t{2}}, numbers,
                          owner);
  out.attr("flags").attr("writeable") = false;
  return out;
}

/// A copy of the memory as bytes, and back.
template <typename Value>
py::bytes copied(const std::vector<Value>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value)};
}

template <typename Value>
void assign(const py::handle& bytes, std::vector<Value>& values) {
  const auto memory = bytes.cast<std::string_view>();
  values.resize(memory.size() / sizeof(Value));
  if (!values.empty())
    std::memcpy(static_cast<void*>(values.data()), memory.data(), values.size() * sizeof(Value));
}

template <typename Value>
auto viewOf(std::vector<Value> Match::*member) {
  return [member](const py::object& self) { return view(self.cast<const Match&>().*member, self); };
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

std::string textOf(const Match& match) {
  if (match.status != "ok") return "<ktgp_orb_core.Match: " + match.status + ">";
  return "<ktgp_orb_core.Match: ok, " + std::to_string(match.inlier_count) + " inliers, found by " +
         match.found_by + ">";
}

std::shared_ptr<Match> matchImages(const py::object& reference, const py::object& target,
                                   const py::object& preset, const py::kwargs& changes) {
  const PipelineOptions options = pipelineOptions(parametersFrom({preset, changes}, Scope::pair));
  const ImageArray first = greyImage(reference, "reference");
  const ImageArray second = greyImage(target, "target");
  const py::gil_scoped_release others_may_run;
  OrbExtractor extractor(options.orb);
  KtgpMatcher matcher(options.matcher);
  Features features[2];
  extractor.extract(first.pixels, features[0]);
  extractor.extract(second.pixels, features[1]);
  MatchResult result;
  matcher.match(features[0], features[1], result);
  return std::make_shared<Match>(result, features[0], features[1]);
}

void defineMatch(py::module_& module) {
  py::class_<Match, std::shared_ptr<Match>>(
      module, "Match",
      "The result for two images. Arrays have a row for each correspondence: first those of the "
      "four stages, in "
      "the order of the target's keypoints, then those that guided matching or the growth added.")
      .def_readonly("status", &Match::status, "\"ok\", or why there is no homography.")
      .def_readonly("found_by", &Match::found_by, "\"prosac\", \"growth\" or \"none\".")
      .def_readonly("homography", &Match::homography,
                    "(3, 3) float64: reference to target, px; zero unless status is ok.")
      .def_readonly("covariance", &Match::covariance,
                    "(8, 8) float64: of the first eight entries of the homography, row by row, "
                    "with H[2, 2] = 1.")
      .def_readonly(
          "shared_covariance", &Match::shared_covariance,
          "(8, 8) float64: the part of the covariance that many matches cannot average out.")
      .def_readonly("plane_deviation", &Match::plane_deviation,
                    "How far the scene is from a plane, px; 0: not detectably.")
      .def_readonly("inlier_count", &Match::inlier_count, "Number of inliers of the homography.")
      .def_readonly("rmse", &Match::rmse,
                    "Root mean square of the reprojection errors of the inliers, px.")
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
          "(N,) uint8: the last stage passed. 0 KNN, 1 + TF, 2 + GMS, 3 + PROSAC: an inlier, 4 an "
          "inlier from guided matching or growth.")
      .def("__repr__", textOf)
      .def(py::pickle([](const Match& match) { return stateOf(match); },
                      [](const py::tuple& state) {
                        auto match = std::make_shared<Match>();
                        restore(state, *match);
                        return match;
                      }));
}

/// With the images, which the sub-pixel alignment needs.
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

void defineFeatures(py::module_& module) {
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
           "cv2.KeyPoint;\n"
           "descriptors: (N, 32) uint8; image_size: (width, height); descriptor: \"orb\" or "
           "\"teblid\".\n"
           "Without the images there is no sub-pixel alignment. Raises ValueError.")
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

Match::Match(const MatchResult& result, const Features& reference, const Features& target)
    : status(toString(result.status)),
      found_by(toString(result.found_by)),
      homography(result.answer.homography),
      covariance(result.answer.covariance),
      shared_covariance(result.answer.shared_covariance),
      plane_deviation(result.answer.plane_deviation),
      inlier_count(result.inliers),
      rmse(result.rmse) {
  const auto keep = [this](const StageResult& stage) {
    if (*stage.name == '\0') return;
    stages.push_back({stage.name, stage.input, stage.output, stage.milliseconds});
  };
  for (const StageResult& stage : result.stages) keep(stage);
  for (const StageResult& stage : result.refinements) keep(stage);
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
}

py::tuple stateOf(const Match& m) {
  return py::make_tuple(
      m.status, m.found_by, m.homography, m.covariance, m.shared_covariance, m.plane_deviation,
      m.inlier_count, m.rmse, stagesOf(m), copied(m.reference_points), copied(m.target_points),
      copied(m.reference_indices), copied(m.target_indices), copied(m.distances), copied(m.levels));
}

void restore(const py::tuple& state, Match& m) {
  std::size_t next = 0;
  const auto take = [&](auto& value) {
    value = state[next++].cast<std::decay_t<decltype(value)>>();
  };
  take(m.status);
  take(m.found_by);
  take(m.homography);
  take(m.covariance);
  take(m.shared_covariance);
  take(m.plane_deviation);
  take(m.inlier_count);
  take(m.rmse);
  for (const auto& stage : state[next++]) {
    m.stages.push_back({stage["name"].cast<std::string>(), stage["input"].cast<std::size_t>(),
                        stage["output"].cast<std::size_t>(), stage["milliseconds"].cast<double>()});
  }
  const auto take_array = [&](auto& values) { assign(state[next++], values); };
  take_array(m.reference_points);
  take_array(m.target_points);
  take_array(m.reference_indices);
  take_array(m.target_indices);
  take_array(m.distances);
  take_array(m.levels);
}

// New memory for the images of each frame would cost 2 % of its time.
std::shared_ptr<Features> Extractor::unusedFeatures() {
  constexpr std::size_t kMost = 4;
  for (const auto& features : made_) {
    if (features.use_count() == 1) return features;
  }
  auto features = std::make_shared<Features>();
  if (made_.size() < kMost) made_.push_back(features);
  return features;
}

Extractor::Extractor(const Settings& settings)
    : settings_(settings), extractor_(pipelineOptions(parametersFrom(settings, Scope::pair)).orb) {}

std::shared_ptr<Features> Extractor::extract(const py::object& image, const py::object& mask) {
  const ImageArray grey = greyImage(image, "image");
  const ImageArray where = maskImage(mask);
  const Shared::Use use(shared_);
  auto features = unusedFeatures();
  extractor_.extract(grey.pixels, where.pixels, *features);
  return features;
}

Matcher::Matcher(const Settings& settings)
    : settings_(settings),
      matcher_(pipelineOptions(parametersFrom(settings, Scope::pair)).matcher) {}

std::shared_ptr<Match> Matcher::match(const Features& reference, const Features& target) {
  const Shared::Use use(shared_);
  matcher_.match(reference, target, result_);
  return std::make_shared<Match>(result_, reference, target);
}

void definePairs(py::module_& module) {
  defineFeatures(module);
  defineMatch(module);
  py::class_<Extractor> extractor(module, "Extractor",
                                  "Finds keypoints and descriptors. Threads may share an object.");
  defineSettings(extractor, "ktgp",
                 "Keywords are the parameters of doc/parameters.md, e.g. features=1000. Raises "
                 "ValueError.");
  extractor.def(
      "extract", &Extractor::extract, py::arg("image"), py::arg("mask") = py::none(),
      "image: (height, width) uint8, grey and not copied where its rows are dense, or "
      "(height, width, 3),\n"
      "blue, green, red; mask: (height, width) uint8, keypoints are found where it is not 0. "
      "Returns "
      "Features.\nRaises ValueError.");
  py::class_<Matcher> matcher(module, "Matcher",
                              "Matches the features of two images. Threads may share an object.");
  defineSettings(matcher, "ktgp",
                 "Keywords are the parameters of doc/parameters.md, e.g. T_w=0.8. Raises "
                 "ValueError.");
  matcher.def("match", &Matcher::match, py::arg("reference"), py::arg("target"),
              "reference, target: Features. Returns Match. Raises ValueError for descriptors of "
              "two kinds.");
  module.def(
      "match", matchImages, py::arg("reference"), py::arg("target"), py::arg("preset") = "ktgp",
      "Matches two images: (height, width) uint8, or (height, width, 3) in the order blue, green, "
      "red.\n\n"
      "preset: \"ktgp\", \"photo\", \"robust\", \"teblid\" or \"video\"; keywords are the "
      "parameters of "
      "doc/parameters.md,\ne.g. T_w=0.8. Returns Match. Raises ValueError.");
}

}  // namespace ktgp_orb::python
