#include "demo/table.h"

#include <ktgp_orb/MatchStatus.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "util/format.h"

namespace ktgp_orb::demo {
namespace {

using util::format;

const char* const kStages[] = {"features", "KNN", "TF", "GMS", "PROSAC"};
const char* const kTimes[] = {"extract", "KNN", "TF", "GMS", "PROSAC", "total"};

double mean(const std::vector<double>& values) {
  if (values.empty()) return 0.0;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// Nearest-rank percentile, `share` in 0..1.
double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto last = static_cast<double>(values.size() - 1);
  const auto rank = static_cast<std::size_t>(std::lround(share * last));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(rank),
                   values.end());
  return values[rank];
}

std::string p50p95(const std::vector<double>& values) {
  return format("%.2f / %.2f", percentile(values, 0.5), percentile(values, 0.95));
}

}  // namespace

std::string frameLine(std::size_t frame, std::size_t frames, const MatchStatistics& statistics,
                      const FrameResult& result) {
  std::string line = format("%3zu/%zu %-8s", frame, frames, result.segment.c_str());
  if (statistics.status == MatchStatus::STATUS_NO_REFERENCE) return line + " no reference";
  for (const StageStatistics& stage : statistics.stages) {
    line += format(" %s %u", stage.name.c_str(), stage.output);
  }
  line += format("  ms orb %.1f", statistics.extraction_milliseconds);
  for (const StageStatistics& stage : statistics.stages)
    line += format(" %.2f", stage.milliseconds);
  if (std::isfinite(result.error)) return line + format("  error %.2f px", result.error);
  return line + "  no homography";
}

void ResultTable::Column::add(const MatchStatistics& statistics, const FrameResult& result) {
  ++frames;
  counts[0].push_back(statistics.target_features);
  milliseconds[0].push_back(statistics.extraction_milliseconds);
  if (statistics.status == MatchStatus::STATUS_NO_REFERENCE) return;
  for (std::size_t i = 0; i < 4; ++i) {
    counts[i + 1].push_back(statistics.stages[i].output);
    milliseconds[i + 1].push_back(statistics.stages[i].milliseconds);
  }
  milliseconds[5].push_back(statistics.total_milliseconds);
  retention.push_back(statistics.retention);
  if (!std::isfinite(result.error)) return;
  ++found;
  error.push_back(result.error);
  reprojection_error.push_back(result.reprojection_error);
}

void ResultTable::add(const MatchStatistics& statistics, const FrameResult& result) {
  if (segments_.count(result.segment) == 0) order_.push_back(result.segment);
  all_.add(statistics, result);
  segments_[result.segment].add(statistics, result);
  dropped_ = statistics.dropped_frames;
}

std::string ResultTable::text(std::size_t in_bag) const {
  std::vector<const Column*> columns{&all_};
  std::string text = format("%-26s%16s", "", "all");
  for (const std::string& name : order_) {
    columns.push_back(&segments_.at(name));
    text += format("%16s", name.c_str());
  }
  const auto row = [&](const std::string& name, const auto& cell) {
    text += format("\n%-26s", name.c_str());
    for (const Column* column : columns) text += format("%16s", cell(*column).c_str());
  };
  row("frames processed", [](const Column& c) { return format("%zu", c.frames); });
  row("homographies found", [](const Column& c) { return format("%zu", c.found); });
  for (std::size_t i = 0; i < 5; ++i) {
    row(format("mean count, %s", kStages[i]),
        [i](const Column& c) { return format("%.1f", mean(c.counts[i])); });
  }
  row("retention Q", [](const Column& c) { return format("%.3f", mean(c.retention)); });
  for (std::size_t i = 0; i < 6; ++i) {
    row(format("ms p50 / p95, %s", kTimes[i]),
        [i](const Column& c) { return p50p95(c.milliseconds[i]); });
  }
  row("corner error p50 / p95, px", [](const Column& c) { return p50p95(c.error); });
  row("reprojection error, px",
      [](const Column& c) { return format("%.3f", mean(c.reprojection_error)); });
  const std::size_t known = all_.frames + dropped_;
  text += format("\nframes in the bag %zu = processed by the matcher %zu", in_bag, all_.frames);
  if (dropped_ > 0) text += format(" + dropped, since newer ones had arrived, %zu", dropped_);
  if (known < in_bag) text += format(" + lost on the way to the matcher %zu", in_bag - known);
  text += '\n';
  text +=
      "Corner error: how far the homography puts the corners of the image from their true places, "
      "mean over the corners.\nReprojection error: how far the keypoints of the final matches are "
      "from their true places, root mean square;\nabout 1 px, since keypoints lie on whole pixels. "
      "The homography comes from aligned points.\n";
  return text;
}

}  // namespace ktgp_orb::demo
