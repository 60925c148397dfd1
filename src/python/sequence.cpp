#include <pybind11/stl.h>

#include <optional>

#include "ktgp_orb/sequence_matcher.h"
#include "parameters/options.h"
#include "python/arrays.h"
#include "python/match.h"
#include "python/options.h"
#include "python/shared.h"

namespace ktgp_orb::python {
namespace {

std::shared_ptr<FrameMatch> copied(const SequenceMatch& found) {
  static const Features none;
  const Features& reference = found.reference ? found.reference->features : none;
  auto out = std::make_shared<FrameMatch>(found.match, reference, found.frame->features);
  out->repeated = found.repeated;
  out->no_reference = toString(found.no_reference);
  if (found.accumulated) out->accumulated = found.accumulated->homography;
  out->stamp = found.frame->stamp;
  out->reference_stamp = found.reference ? found.reference->stamp : 0;
  out->image_size = found.frame->features.image_size;
  out->reference_size = reference.image_size;
  out->tracks.reserve(out->target_indices.size());
  for (const std::int32_t i : out->target_indices) {
    out->tracks.push_back(found.frame->tracks[static_cast<std::size_t>(i)]);
  }
  return out;
}

/// A sequence that several Python threads may call; their calls run one after the other.
class Sequence {
 public:
  explicit Sequence(const Settings& made_from)
      : settings(made_from),
        matcher_(sequenceOptions(parametersFrom(made_from, Scope::sequence))) {}

  std::shared_ptr<FrameMatch> match(const py::object& image, double seconds) {
    const ImageArray grey = greyImage(image, "image");
    return matcher_.use(
        [&](SequenceMatcher& matcher) { return copied(matcher.match(grey.pixels, seconds)); });
  }

  void setReference(const py::object& image) {
    const ImageArray grey = greyImage(image, "image");
    matcher_.use([&](SequenceMatcher& matcher) {
      if (matcher.options().reference.mode != ReferenceMode::fixed) {
        throw py::value_error("set_reference has no effect; expected reference_mode=\"fixed\"");
      }
      const FramePtr frame = matcher.newFrame();
      grey.pixels.copyTo(frame->image);
      frame->stamp = --reference_stamp_;
      matcher.setFixedReference(frame);
    });
  }

  void restart() {
    matcher_.use([](SequenceMatcher& matcher) { matcher.restart(); });
  }

  const Settings settings;

 private:
  Shared<SequenceMatcher> matcher_;
  // Stamp of the newest fixed reference, ns. It is negative, so it differs from those of the
  // frames, and each reference has its own, because the consumers tell images by their stamps.
  std::int64_t reference_stamp_ = 0;
};

py::tuple frameState(const FrameMatch& m) {
  return py::make_tuple(stateOf(m), m.no_reference, m.accumulated, m.stamp, m.reference_stamp,
                        m.image_size.width, m.image_size.height, m.tracks, m.repeated,
                        m.reference_size.width, m.reference_size.height);
}

std::shared_ptr<FrameMatch> frameOf(const py::tuple& state) {
  auto match = std::make_shared<FrameMatch>();
  restore(state[0], *match);
  match->no_reference = state[1].cast<std::string>();
  match->accumulated = state[2].cast<std::optional<Eigen::Matrix3d>>();
  match->stamp = state[3].cast<std::int64_t>();
  match->reference_stamp = state[4].cast<std::int64_t>();
  match->image_size = cv::Size(state[5].cast<int>(), state[6].cast<int>());
  match->tracks = state[7].cast<std::vector<std::uint64_t>>();
  match->repeated = state[8].cast<bool>();
  match->reference_size = cv::Size(state[9].cast<int>(), state[10].cast<int>());
  return match;
}

void defineFrameMatch(py::module& module) {
  py::class_<FrameMatch, Match, std::shared_ptr<FrameMatch>>(
      module, "FrameMatch", "The result for a frame of a sequence.")
      .def_readonly("no_reference", &FrameMatch::no_reference,
                    "Why the frame had no reference, e.g. \"first_frame\"; \"none\": it had one.")
      .def_readonly("repeated", &FrameMatch::repeated,
                    "The image repeats the one before and is no new frame: all else is that of the "
                    "frame before.")
      .def_readonly("accumulated", &FrameMatch::accumulated,
                    "(3, 3) float64: from the first frame of the unbroken sequence to this one, "
                    "px; or None.")
      .def_property_readonly(
          "seconds", [](const FrameMatch& m) { return secondsOf(m.stamp); },
          "As given to Sequence.match, rounded to nanoseconds.")
      .def_property_readonly(
          "reference_seconds", [](const FrameMatch& m) { return secondsOf(m.reference_stamp); },
          "`seconds` of the reference; 0 without one, and negative for a reference of "
          "Sequence.set_reference.")
      .def_property_readonly(
          "tracks",
          [](const py::object& self) { return view(self.cast<const FrameMatch&>().tracks, self); },
          "(N,) uint64: the track of the target keypoint of each match. It stays with a keypoint "
          "while final matches, of levels 3 and 4, lead from frame to frame.")
      .def(py::pickle(&frameState, &frameOf));
}

}  // namespace

void defineSequence(py::module& module) {
  defineFrameMatch(module);
  py::class_<Sequence> sequence(
      module, "Sequence",
      "Matches the frames of a camera one after the other. Threads may share an object. A copy by "
      "pickle begins anew.");
  defineSettings(
      sequence, "video",
      "Keywords are the parameters of doc/parameters.md, also reference_mode (\"previous\", "
      "\"keyframe\",\n\"fixed\") and max_reference_age. A fixed reference is seen from anywhere: "
      "without a preset\nof another name than \"video\", what views that differ strongly need is "
      "used in place of the\ndefaults (doc/views.md). Raises ValueError.");
  sequence
      .def("match", &Sequence::match, py::arg("image"), py::arg("seconds"),
           "The next image, taken at `seconds` since any epoch; as for Extractor.extract. Returns "
           "FrameMatch.\nRaises ValueError.")
      .def("set_reference", &Sequence::setReference, py::arg("image"),
           "The reference of mode \"fixed\". Raises ValueError.")
      .def("restart", &Sequence::restart,
           "The next frame is the first of a new sequence; a fixed reference stays.");
}

}  // namespace ktgp_orb::python
