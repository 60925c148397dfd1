#include "evaluation/target_frames.h"

#include <Eigen/Core>
#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "files/input.h"
#include "homography/transform.h"
#include "ktgp_orb/sequence_matcher.h"
#include "parameters/options.h"
#include "util/format.h"

namespace ktgp_orb::evaluation {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using util::format;
using Points = std::vector<Eigen::Vector2d>;

/// The labels of a target in one source. A frame without points does not show the target.
struct Label {
  std::size_t row = 0;
  std::string id;
  Points on_target;
  std::map<std::size_t, Points> in_frame;  // by the number of the frame; a photograph has frame 0
};

struct Source {
  std::string name;
  bool is_video = false;
  std::vector<Label> labels;
};

/// Throws std::invalid_argument.
Points pointsOf(const json& rows) {
  Points points;
  const auto is_point = [](const json& row) {
    return row.is_array() && row.size() == 2 && row[0].is_number() && row[1].is_number();
  };
  if (!rows.is_array() || !std::all_of(rows.begin(), rows.end(), is_point)) {
    throw std::invalid_argument("has points that are no list of [x, y]; expected [[x, y], ...]");
  }
  for (const json& row : rows) points.emplace_back(row[0].get<double>(), row[1].get<double>());
  return points;
}

std::string idOf(const std::string& file) {
  return fs::path(file).stem().string();
}

/// Splits "TARGET IMAGE" into its two files. If their names have blanks, both files must exist.
/// Throws std::invalid_argument.
void setNames(const std::string& folder, const std::string& key, LabelledTarget& row) {
  const bool is_clear = std::count(key.begin(), key.end(), ' ') == 1;
  std::size_t ways = 0;
  for (std::size_t blank = key.find(' '); blank != std::string::npos;
       blank = key.find(' ', blank + 1)) {
    const std::string target = key.substr(0, blank), source = key.substr(blank + 1);
    const auto exists = [&](const std::string& file) {
      return fs::is_regular_file(fs::path(folder) / file);
    };
    if (!is_clear && !(exists(target) && exists(source))) continue;
    ++ways;
    row.target = target;
    row.source = source;
  }
  if (ways == 1) return;
  throw std::invalid_argument("is not \"TARGET IMAGE\" or \"TARGET VIDEO\" with two files of " +
                              folder);
}

std::size_t numberOf(const std::string& text) {
  std::size_t number = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || rest != end) {
    throw std::invalid_argument("has a frame \"" + text + "\"; expected its number, from 0 on");
  }
  return number;
}

/// Throws std::invalid_argument.
Label labelOf(const json& entry) {
  Label label;
  const bool is_image = entry.contains("image");
  if (!entry.contains("target") || is_image == entry.contains("frames") ||
      entry.size() != 2 + entry.count("note") || !(is_image || entry["frames"].is_object())) {
    throw std::invalid_argument(
        "is not {\"target\": points, \"image\": points} or {\"target\": points, \"frames\": "
        "{\"NUMBER\": points, ...}}, with a \"note\" or without");
  }
  label.on_target = pointsOf(entry["target"]);
  if (label.on_target.empty()) throw std::invalid_argument("has no points on the target");
  if (is_image) {
    label.in_frame[0] = pointsOf(entry["image"]);
  } else {
    for (const auto& [number, points] : entry["frames"].items()) {
      label.in_frame[numberOf(number)] = pointsOf(points);
    }
  }
  for (const auto& [number, points] : label.in_frame) {
    if (points.empty() || points.size() == label.on_target.size()) continue;
    throw std::invalid_argument("has " + std::to_string(points.size()) + " points in frame " +
                                std::to_string(number) + "; expected " +
                                std::to_string(label.on_target.size()) +
                                ", as in the target, or none where it is not in the frame");
  }
  return label;
}

/// Throws std::invalid_argument if two targets have the same id, by which the finder knows them.
void requireOwnId(const LabelledTarget& row, const std::vector<LabelledTarget>& others) {
  for (const LabelledTarget& other : others) {
    if (other.target == row.target || idOf(other.target) != idOf(row.target)) continue;
    throw std::invalid_argument("has the target " + row.target + ", and there is " + other.target +
                                "; expected names that differ before their endings");
  }
}

void add(const std::string& folder, const std::string& key, const json& entry,
         std::vector<Source>& sources, std::vector<LabelledTarget>& rows) {
  LabelledTarget row;
  setNames(folder, key, row);
  requireOwnId(row, rows);
  Label label = labelOf(entry);
  label.row = rows.size();
  label.id = idOf(row.target);
  for (const auto& [number, points] : label.in_frame) row.frames += points.empty() ? 0 : 1;
  const auto same = [&](const Source& source) { return source.name == row.source; };
  auto source = std::find_if(sources.begin(), sources.end(), same);
  if (source == sources.end()) source = sources.insert(sources.end(), {row.source, false, {}});
  source->is_video |= !entry.contains("image");
  source->labels.push_back(std::move(label));
  rows.push_back(std::move(row));
}

/// Throws std::invalid_argument if an object has a key twice, of which the parser would keep one.
json parseWithoutTwins(std::istream& in) {
  std::vector<std::set<std::string>> keys;  // of the objects that are open
  return json::parse(in, [&](int /*depth*/, json::parse_event_t event, json& parsed) {
    if (event == json::parse_event_t::object_start) keys.emplace_back();
    if (event == json::parse_event_t::object_end) keys.pop_back();
    if (event == json::parse_event_t::key && !keys.back().insert(parsed).second) {
      throw std::invalid_argument("has the key " + parsed.dump() + " twice");
    }
    return true;
  });
}

std::vector<Source> readLabels(const std::string& folder, LabelledTargets& searched) {
  const std::string file = (fs::path(folder) / "labels.json").string();
  files::requireRegularFile(file);
  std::vector<Source> sources;
  try {
    std::ifstream in(file);
    const json labels = parseWithoutTwins(in);
    if (!labels.is_object() || labels.empty()) {
      throw std::invalid_argument("names no target; expected {\"TARGET IMAGE\": {...}, ...}");
    }
    for (const auto& [key, entry] : labels.items()) {
      try {
        add(folder, key, entry, sources, searched.rows);
      } catch (const std::invalid_argument& error) {
        throw std::invalid_argument('"' + key + "\" " + error.what());
      }
    }
  } catch (const json::exception& error) {
    throw files::FileError(file, error.what());
  } catch (const std::invalid_argument& error) {
    throw files::FileError(file, error.what());
  }
  return sources;
}

/// Mean distance from the labelled points, px. Infinite if the target is not in the frame, because
/// any answer is then wrong.
double errorOf(const Eigen::Matrix3d& homography, const Points& on_target, const Points& in_frame) {
  if (in_frame.empty()) return std::numeric_limits<double>::infinity();
  double sum = 0.0;
  for (std::size_t i = 0; i < on_target.size(); ++i) {
    sum += homography::errorOf(homography, on_target[i], in_frame[i]);
  }
  return sum / static_cast<double>(on_target.size());
}

/// A matcher in fixed mode with this reference. All other parameters have their defaults.
SequenceMatcher withReference(const cv::Mat& image) {
  Parameters parameters;
  parameters.reference_mode = "fixed";
  SequenceMatcher matcher(sequenceOptions(parameters));
  const FramePtr reference = matcher.newFrame();
  reference->image = image;
  matcher.setFixedReference(reference);
  return matcher;
}

bool isIn(const std::vector<Label>& labels, const std::string& id) {
  return std::any_of(labels.begin(), labels.end(),
                     [&](const Label& label) { return label.id == id; });
}

class Searcher {
 public:
  Searcher(const std::string& folder, const TargetFinderOptions& options, LabelledTargets& searched)
      : finder_(options), searched_(searched) {
    for (const LabelledTarget& row : searched.rows) {
      const std::string id = idOf(row.target);
      const cv::Mat image = files::readGrey((fs::path(folder) / row.target).string());
      matchers_.push_back(withReference(image));
      if (finder_.knows(id)) continue;
      Target target;
      target.id = id;
      target.images = {image};
      try {
        finder_.add(target);
      } catch (const std::invalid_argument& error) {
        searched.problems.emplace_back(error.what());
      }
    }
  }

  /// Searches each labelled frame by itself, at all sizes.
  void searchAlone(const Source& source, std::size_t number, const cv::Mat& frame) {
    for (std::size_t s = 0; s < kLabelledSizes.size(); ++s) {
      const bool is_labelled =
          std::any_of(source.labels.begin(), source.labels.end(),
                      [&](const Label& label) { return label.in_frame.count(number) > 0; });
      if (!is_labelled) return;
      cv::Mat small = frame;
      if (s > 0) {
        cv::resize(frame, small, {}, kLabelledSizes[s], kLabelledSizes[s], cv::INTER_AREA);
      }
      const Eigen::Matrix3d to_small = homography::resizing(frame.size(), small.size());
      const TargetFrame& answer = finder_.findAlone(small);
      for (const Label& label : source.labels) {
        const auto points = label.in_frame.find(number);
        if (points == label.in_frame.end()) continue;
        Points in_small;
        for (const Eigen::Vector2d& p : points->second) {
          in_small.push_back(homography::project(to_small, p));
        }
        const double error = leastErrorOf(answer, label, in_small);
        if (error < kFoundWithin) ++searched_.rows[label.row].found[s];
        if (s == 0 && error < kWrongTargetBeyond) ++searched_.rows[label.row].near;
      }
      countOthers(answer, source);
      if (source.is_video) times_[s].push_back(answer.milliseconds);
    }
  }

  /// Searches each frame by the matcher in fixed mode.
  void matchToReference(const Source& source, std::size_t number, const cv::Mat& frame) {
    for (const Label& label : source.labels) {
      const MatchResult& found =
          matchers_[label.row].match(frame, static_cast<double>(number)).match;
      const auto points = label.in_frame.find(number);
      if (points == label.in_frame.end() || found.status != Status::ok) continue;
      const double error = errorOf(found.answer.homography, label.on_target, points->second);
      if (error < kFoundWithin) ++searched_.rows[label.row].fixed;
      if (error > kWrongTargetBeyond) ++searched_.rows[label.row].wrong;
    }
  }

  /// Searches a video from its first frame to its last.
  void follow(const Source& source, std::size_t number, const cv::Mat& frame) {
    if (number == 0) {
      finder_.restart();
      gaps_.assign(source.labels.size(), 0);
    }
    const TargetFrame& answer = finder_.find(frame);
    for (std::size_t i = 0; i < source.labels.size(); ++i) {
      const Label& label = source.labels[i];
      LabelledTarget& row = searched_.rows[label.row];
      ++row.all_frames;
      const auto points = label.in_frame.find(number);
      const bool is_labelled = points != label.in_frame.end();
      if (is_labelled && leastErrorOf(answer, label, points->second) < kFoundWithin) ++row.followed;
      const bool is_absent = is_labelled && points->second.empty();
      const bool is_seen = std::any_of(answer.detections.begin(), answer.detections.end(),
                                       [&](const DetectedTarget& found) {
                                         return found.id == label.id && found.status == Status::ok;
                                       });
      gaps_[i] = is_seen || is_absent ? 0 : gaps_[i] + 1;
      row.longest_gap = std::max(row.longest_gap, gaps_[i]);
    }
    countOthers(answer, source);
  }

  void storeTimes() {
    for (std::size_t s = 0; s < times_.size(); ++s) {
      std::vector<double>& times = times_[s];
      if (times.empty()) continue;
      std::sort(times.begin(), times.end());
      searched_.milliseconds[s] = times[times.size() / 2];
    }
  }

 private:
  /// Smallest error of the answers for the label; infinite: there is no answer.
  double leastErrorOf(const TargetFrame& answer, const Label& label, const Points& in_frame) {
    double least = std::numeric_limits<double>::infinity();
    for (const DetectedTarget& found : answer.detections) {
      if (found.id != label.id || found.status != Status::ok) continue;
      const double error = errorOf(found.homography.homography, label.on_target, in_frame);
      least = std::min(least, error);
      // If there are several instances, only one is labelled.
      const bool counts = found.instance == 0 || in_frame.empty();
      if (counts && error > kWrongTargetBeyond) ++searched_.rows[label.row].wrong;
    }
    return least;
  }

  void countOthers(const TargetFrame& answer, const Source& source) {
    for (const DetectedTarget& found : answer.detections) {
      if (found.status != Status::ok || isIn(source.labels, found.id)) continue;
      ++searched_.rows[source.labels[0].row].others;
    }
  }

  TargetFinder finder_;
  std::vector<SequenceMatcher> matchers_;  // one per row
  LabelledTargets& searched_;
  std::vector<std::size_t> gaps_;  // frames since the last answer, for each label of the video
  std::array<std::vector<double>, kLabelledSizes.size()> times_;
};

std::string shareOf(std::size_t part, std::size_t all) {
  if (all == 0) return "-";
  return format("%.3f", static_cast<double>(part) / static_cast<double>(all));
}

/// Drops labels beyond the last frame, which would count as not found.
void dropLabelsBeyond(const Source& source, std::size_t frames, LabelledTargets& searched) {
  for (const Label& label : source.labels) {
    LabelledTarget& row = searched.rows[label.row];
    for (auto beyond = label.in_frame.lower_bound(frames); beyond != label.in_frame.end();
         ++beyond) {
      row.frames -= beyond->second.empty() ? 0 : 1;
      searched.problems.push_back("labels.json: \"" + row.target + ' ' + row.source +
                                  "\" has a label for frame " + std::to_string(beyond->first) +
                                  ", and the video has " + std::to_string(frames) +
                                  " frames, from 0 on; it is left out");
    }
  }
}

}  // namespace

LabelledTargets searchLabelled(const std::string& folder, const TargetFinderOptions& options) {
  LabelledTargets searched;
  const std::vector<Source> sources = readLabels(folder, searched);
  Searcher searcher(folder, options, searched);
  for (const Source& source : sources) {
    const std::string file = (fs::path(folder) / source.name).string();
    if (!source.is_video) {
      const cv::Mat photograph = files::readGrey(file);
      searcher.searchAlone(source, 0, photograph);
      searcher.matchToReference(source, 0, photograph);
      continue;
    }
    cv::VideoCapture video(file);
    cv::Mat colour, grey;
    std::size_t number = 0;
    for (; video.read(colour); ++number) {
      cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
      searcher.follow(source, number, grey);
      searcher.searchAlone(source, number, grey);
      searcher.matchToReference(source, number, grey);
    }
    if (number == 0) {
      searched.problems.push_back(file + ": cannot be read as a video");
      for (const Label& label : source.labels) searched.rows[label.row].frames = 0;
    } else {
      dropLabelsBeyond(source, number, searched);
    }
  }
  searcher.storeTimes();
  return searched;
}

std::string toTable(const LabelledTargets& searched) {
  const auto line = [](const std::string& first, const std::string& second, std::size_t frames,
                       const std::string& near, const auto& cells, const std::string& followed,
                       const std::string& gap, const std::string& fixed, std::size_t wrong,
                       std::size_t others) {
    return format("%-14s %-20s %6zu  %6s %6s %6s %6s %6s %6s  %8s %5s %6s %6zu %9zu\n",
                  first.c_str(), second.c_str(), frames, near.c_str(), cells[0].c_str(),
                  cells[1].c_str(), cells[2].c_str(), cells[3].c_str(), cells[4].c_str(),
                  followed.c_str(), gap.c_str(), fixed.c_str(), wrong, others);
  };
  constexpr const char* kHead =
      "Share of the labelled images in which the target is found within 5 px: each image by "
      "itself\n"
      "at five sizes, in the whole video, and by the matcher's reference_mode fixed; <15: within "
      "15 px,\n"
      "at full size. Wrong: answers beyond 15 px, and those where a label says that the target is "
      "not there.\n"
      "Ids: of targets without a label there.\n\n"
      "target         source               labels     <15      1     .5    .35    .25    .18  "
      "followed   gap  fixed  wrong wrong ids\n";
  std::string out = kHead;
  std::array<std::size_t, kLabelledSizes.size()> found{};
  std::size_t labels = 0, near = 0, in_videos = 0, followed = 0, fixed = 0, wrong = 0, others = 0,
              gap = 0;
  for (const LabelledTarget& row : searched.rows) {
    std::array<std::string, kLabelledSizes.size()> cells;
    for (std::size_t s = 0; s < cells.size(); ++s) {
      cells[s] = shareOf(row.found[s], row.frames);
      found[s] += row.found[s];
    }
    const std::size_t of_video = row.all_frames > 0 ? row.frames : 0;
    out += line(row.target, row.source, row.frames, shareOf(row.near, row.frames), cells,
                shareOf(row.followed, of_video),
                row.all_frames > 0 ? std::to_string(row.longest_gap) : "-",
                shareOf(row.fixed, row.frames), row.wrong, row.others);
    labels += row.frames;
    near += row.near;
    in_videos += of_video;
    followed += row.followed;
    fixed += row.fixed;
    wrong += row.wrong;
    others += row.others;
    gap = std::max(gap, row.longest_gap);
  }
  std::array<std::string, kLabelledSizes.size()> cells;
  for (std::size_t s = 0; s < cells.size(); ++s) cells[s] = shareOf(found[s], labels);
  out += line("all", "", labels, shareOf(near, labels), cells, shareOf(followed, in_videos),
              std::to_string(gap), shareOf(fixed, labels), wrong, others);
  const auto& ms = searched.milliseconds;
  return out +
         format(
             "ms, median of videos                               %6.1f %6.1f %6.1f %6.1f %6.1f\n",
             ms[0], ms[1], ms[2], ms[3], ms[4]);
}

}  // namespace ktgp_orb::evaluation
