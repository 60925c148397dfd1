#include "cli/matcher_cli.h"

#include <iomanip>
#include <map>
#include <sstream>

namespace ktgp_orb::tools {
namespace {

/// Allowed values of an option.
struct Range {
  double low;
  double high;
  bool low_open = false;   ///< `low` itself is not allowed
  bool high_open = false;  ///< `high` itself is not allowed

  bool contains(double value) const {
    return (low_open ? value > low : value >= low) && (high_open ? value < high : value <= high);
  }
  std::string text() const {
    std::ostringstream out;
    out << std::setprecision(10) << (low_open ? '(' : '[') << low << ", " << high
        << (high_open ? ')' : ']');
    return out.str();
  }
};

const std::map<std::string, ExtractorKind> kExtractors{{"fast", ExtractorKind::native},
                                                       {"opencv", ExtractorKind::opencv}};
const std::map<std::string, KeypointDistribution> kDistributions{
    {"ranked", KeypointDistribution::ranked}, {"uniform", KeypointDistribution::uniform}};

template <typename T>
std::string nameOf(T value, const std::map<std::string, T>& choices) {
  for (const auto& [name, choice] : choices) {
    if (choice == value) return name;
  }
  return "";
}

/// Options that --help shows together.
class Group {
 public:
  Group(CLI::App& app, std::string title) : app_(app), title_(std::move(title)) {}

  template <typename T>
  void add(const std::string& name, T& value, const Range& range, const std::string& description) {
    const auto check = [range](const std::string& text) -> std::string {
      double number = 0.0;
      if (!CLI::detail::lexical_cast(text, number)) return text + " is not a number";
      if (range.contains(number)) return {};
      return text + " is out of range; expected a value in " + range.text();
    };
    app_.add_option(name, value, description)
        ->check(check, "in " + range.text())
        ->capture_default_str()
        ->group(title_);
  }

  template <typename T>
  void addChoice(const std::string& name, T& value, const std::map<std::string, T>& choices,
                 const std::string& description) {
    const auto choose = [&value, choices, name](const std::string& text) {
      const auto choice = choices.find(text);
      if (choice != choices.end()) {
        value = choice->second;
        return;
      }
      std::string names;
      for (const auto& entry : choices) names += (names.empty() ? "" : " or ") + entry.first;
      throw CLI::ValidationError(name, text + " is unknown; expected " + names);
    };
    app_.add_option_function<std::string>(name, choose, description)
        ->type_name("NAME")
        ->default_str(nameOf(value, choices))
        ->group(title_);
  }

  void addFlag(const std::string& name, bool& value, const std::string& description) {
    app_.add_flag(name, value, description)->group(title_);
  }

 private:
  CLI::App& app_;
  std::string title_;
};

}  // namespace

void addPipelineOptions(CLI::App& app, PipelineOptions& options) {
  OrbOptions& orb = options.orb;
  Group features(app, "Features (ORB)");
  features.add("--features", orb.max_features, {1, 1e6}, "keypoints to keep at most");
  features.add("--scale-factor", orb.scale_factor, {1.01, 2},
               "size ratio of neighbouring pyramid levels");
  features.add("--levels", orb.levels, {1, 16}, "pyramid levels");
  features.add("--fast-threshold", orb.fast_threshold, {1, 255},
               "contrast of a FAST corner, grey values; lower it for dark or blurred images");

  features.addChoice("--extractor", orb.extractor, kExtractors,
                     "fast = vector code, opencv = cv::ORB; the keypoints are the same");
  features.addChoice("--distribution", orb.distribution, kDistributions,
                     "ranked = the strongest corners, uniform = an equal share of every part");
  features.add("--cell-share", orb.keypoints_per_cell, {1, 1e6},
               "with uniform: keypoints that each cell keeps where all have enough");
  features.add("--orb-threads", orb.threads, {0, 1024},
               "threads of the extractor, 0 = all of the machine; the answer is the same");

  MatcherOptions& matcher = options.matcher;
  Group search(app, "Nearest neighbours and ratio filter (KNN, TF)");
  search.add("--ratio-threshold", matcher.ratio_threshold, {0, 1, true},
             "T_w: keep a match when d1/d2 is below; larger keeps more, and more wrong ones");
  search.add("--threads", matcher.knn.threads, {0, 1024},
             "threads of the search, 0 = all of the machine; the answer is the same");

  GmsOptions& gms = matcher.gms;
  Group statistics(app, "Motion statistics (GMS)");
  statistics.add("--gms-threshold", gms.threshold, {0, 1e6},
                 "T_G: support that a match needs from its neighbours; larger keeps fewer");
  statistics.addFlag("--gms-rotation", gms.rotation, "allow the camera to roll (eight directions)");
  statistics.addFlag("--gms-scale", gms.scale, "allow a change of scale (factors 1/2 to 2)");
  statistics.add("--gms-columns", gms.grid_columns, {1, 200}, "grid cells across the target image");
  statistics.add("--gms-rows", gms.grid_rows, {1, 200}, "grid cells down the target image");

  ProsacOptions& prosac = matcher.prosac;
  Group model(app, "Homography (PROSAC)");
  model.add("--prosac-threshold", prosac.max_error, {0, 1e6, true},
            "a match is an inlier when its reprojection error is below, px");
  model.add("--max-iterations", prosac.max_iterations, {1, 1e6}, "samples drawn at most");
  model.add("--confidence", prosac.confidence, {0, 1, true, true},
            "wanted probability that no better homography was missed");
  model.add("--seed", prosac.seed, {0, 9007199254740992},
            "of the random generator; same seed, same answer");
}

nlohmann::json toJson(const PipelineOptions& options) {
  const auto& [orb, matcher] = options;
  return {
      {"features", orb.max_features},
      {"scale-factor", orb.scale_factor},
      {"levels", orb.levels},
      {"fast-threshold", orb.fast_threshold},
      {"extractor", nameOf(orb.extractor, kExtractors)},
      {"distribution", nameOf(orb.distribution, kDistributions)},
      {"cell-share", orb.keypoints_per_cell},
      {"orb-threads", orb.threads},
      {"ratio-threshold", matcher.ratio_threshold},
      {"threads", matcher.knn.threads},
      {"gms-threshold", matcher.gms.threshold},
      {"gms-rotation", matcher.gms.rotation},
      {"gms-scale", matcher.gms.scale},
      {"gms-columns", matcher.gms.grid_columns},
      {"gms-rows", matcher.gms.grid_rows},
      {"prosac-threshold", matcher.prosac.max_error},
      {"max-iterations", matcher.prosac.max_iterations},
      {"confidence", matcher.prosac.confidence},
      {"seed", matcher.prosac.seed},
  };
}

std::optional<int> parse(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return std::nullopt;
}

}  // namespace ktgp_orb::tools
