#include <pybind11/stl.h>

#include <optional>

#include "ktgp_orb/sequence_matcher.h"
#include "parameters/options.h"
#include "python/arrays.h"
#include "python/match.h"
#include "python/options.h"

namespace ktgp_orb::python {
namespace {

/// The result for a frame.
struct FrameMatch : Match {
  using Match::Match;
  std::string no_reference;
  std::optional<Eigen::Matrix3d> accumulated;
};

/// A sequence that several Python threads may call; one of them works at a time.
class Sequence {
 public:
  explicit Sequence(const SequenceOptions& options) : matcher_(options) {}

  std::shared_ptr<FrameMatch> match(const py::object& image, double seconds) {
    const GreyImage grey = greyImage(image, "image");
    const py::gil_scoped_release others_may_run;
    const std::lock_guard<std::mutex> lock(mutex_);
    const SequenceMatch& found = matcher_.match(grey.pixels, seconds);
    static const Features none;
    const Features& reference = found.reference ? found.reference->features : none;
    auto out = std::make_shared<FrameMatch>(found.match, reference, found.frame->features);
    out->no_reference = toString(found.no_reference);
    if (found.accumulated) out->accumulated = found.accumulated->homography;
    return out;
  }

  void setReference(const py::object& image) {
    const GreyImage grey = greyImage(image, "image");
    const py::gil_scoped_release others_may_run;
    const std::lock_guard<std::mutex> lock(mutex_);
    const FramePtr frame = matcher_.newFrame();
    grey.pixels.copyTo(frame->image);
    matcher_.setFixedReference(frame);
  }

  void restart() {
    const std::lock_guard<std::mutex> lock(mutex_);
    matcher_.restart();
  }

 private:
  SequenceMatcher matcher_;
  std::mutex mutex_;
};

}  // namespace

void defineSequence(py::module_& module) {
  py::class_<FrameMatch, Match, std::shared_ptr<FrameMatch>>(
      module, "FrameMatch", "The result for a frame of a sequence.")
      .def_readonly("no_reference", &FrameMatch::no_reference,
                    "Why the frame had no reference, e.g. \"first_frame\"; \"none\": it had one.")
      .def_readonly("accumulated", &FrameMatch::accumulated,
                    "(3, 3) float64: from the first frame of the unbroken sequence to this one, "
                    "px; or None.");
  py::class_<Sequence>(
      module, "Sequence",
      "Matches the frames of a camera one after the other. Threads may share an object.")
      .def(py::init([](const std::string& preset, const py::kwargs& changes) {
             return std::make_unique<Sequence>(
                 sequenceOptions(parametersFrom(preset, changes, Scope::sequence)));
           }),
           py::arg("preset") = "video",
           "Keywords are the parameters of doc/parameters.md, also reference_mode (\"previous\", "
           "\"keyframe\",\n"
           "\"fixed\") and max_reference_age. Raises ValueError.")
      .def("match", &Sequence::match, py::arg("image"), py::arg("seconds"),
           "The next image, taken at `seconds` since any epoch; as for Extractor.extract. Returns "
           "FrameMatch.\n"
           "Raises ValueError.")
      .def("set_reference", &Sequence::setReference, py::arg("image"),
           "The reference of mode \"fixed\".")
      .def("restart", &Sequence::restart, py::call_guard<py::gil_scoped_release>(),
           "The next frame is the first of a new sequence; a fixed reference stays.");
}

}  // namespace ktgp_orb::python
