// ktgp_evaluate: runs named methods on image sets with known truth.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <future>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <set>
#include <sstream>

#include "evaluation/hpatches.h"
#include "evaluation/output.h"
#include "evaluation/peers.h"
#include "evaluation/two_view_evaluation.h"
#include "files/input.h"
#include "files/output_file.h"
#include "ktgp_orb/metrics.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"

namespace ktgp_orb::evaluation {
namespace {

constexpr const char* kDescription =
    "Runs matching methods over image pairs with a known homography and measures them.\n"
    "DATA is an Oxford/VGG folder (img1.ppm ... img6.ppm, H1to2p ... H1to6p), an HPatches folder\n"
    "(1.ppm ... 6.ppm, H_1_2 ... H_1_6), one of extreme views (1/NAME.png, 2/NAME.png, "
    "h/NAME.txt)\n"
    "or of annotated pairs (NAMEA.png, NAMEB.png, NAME.points with rows `xA yA xB yB`), a folder "
    "of\n"
    "such folders, or a text file with `name imageA imageB truth` a line. With --warps, DATA are "
    "images or folders of "
    "images,\n"
    "and the pairs are exact warps of them. With --two-view, DATA are folders of scenes with depth "
    "and\n"
    "a cameras.txt with a row `file fx fy cx cy R11 R12 ... R33 t1 t2 t3` per image, x_camera = "
    "R X + t.\nFor recordings there is ktgp_evaluate_bag.";

constexpr const char* kExamples =
    "Examples:\n"
    "  ktgp_evaluate oxford/leuven oxford/bikes\n"
    "  ktgp_evaluate oxford --methods all --csv results.csv --json results.json\n"
    "  ktgp_evaluate my_pairs.txt --methods KTG,KTGP --T_G 4 --jobs 4\n"
    "  ktgp_evaluate hpatches --methods KTGP,MP-ORB --estimator usac\n"
    "  ktgp_evaluate --hpatches hpatches-sequences-release --jobs 4\n"
    "  ktgp_evaluate --warps small,medium,large --methods KTGP,SIFT,ECC photo.jpg oxford/boat\n"
    "  ktgp_evaluate --two-view --apart 1,3,6 kitti_2\n"
    "\n"
    "Exit code: 0 everything was evaluated, 1 a file was missing or broken or a method failed on "
    "a\n"
    "pair (it is named, the rest is evaluated), 2 options, inputs or outputs cannot be used, 130 "
    "interrupted (Ctrl-C).";

struct Arguments {
  std::vector<std::string> data;
  std::vector<std::string> methods{"ORB", "ORB+RANSAC", "KT", "KTG", "KTGP", "KTGP+ALIGN"};
  std::string estimator;
  std::string json;
  std::string csv;
  int jobs = 1;
  int repeat = 1;
  bool list_methods = false;
  std::string warps;
  int warp_pairs = 48;
  EvaluatedSize size;
  bool hpatches = false;
  bool two_view = false;
  std::vector<int> apart;  // empty: not given
  double truth_deviation = 0.0;
  std::uint64_t warp_seed = 1;
  std::string bag;
  bool force = false;
  PipelineOptions pipeline;
};

/// Our methods and OpenCV's.
std::vector<Method> knownMethods(const Arguments& arguments) {
  const PipelineOptions& options = arguments.pipeline;
  std::vector<Method> methods = allMethods(options, arguments.estimator);
  for (Method& peer : peerMethods(options.matcher.prosac, arguments.estimator)) {
    methods.push_back(std::move(peer));
  }
  if (arguments.hpatches) methods.push_back(hpatches::siftWithOurEstimator(options));
  return methods;
}

/// The methods that this build supports.
std::vector<Method> available(std::vector<Method> methods) {
  const auto is_missing = [](const Method& m) { return !m.unavailable.empty(); };
  methods.erase(std::remove_if(methods.begin(), methods.end(), is_missing), methods.end());
  return methods;
}

/// The methods named in the arguments, in their order. Throws std::invalid_argument.
std::vector<Method> wantedMethods(const Arguments& arguments) {
  std::vector<Method> all = knownMethods(arguments);
  std::vector<Method> wanted;
  for (const std::string& name : arguments.methods) {
    if (name == "all") return available(std::move(all));
    const auto found = std::find_if(all.begin(), all.end(),
                                    [&](const Method& method) { return method.name == name; });
    if (found == all.end()) {
      throw std::invalid_argument("there is no method " + name + "; --list-methods names them");
    }
    if (!found->unavailable.empty()) {
      throw std::invalid_argument("method " + name + " is " + found->unavailable);
    }
    wanted.push_back(*found);
  }
  return wanted;
}

void listMethods(const Arguments& arguments) {
  for (const Method& method : knownMethods(arguments)) {
    const std::string& text = method.unavailable.empty() ? method.description : method.unavailable;
    std::printf("%-12s %s\n", method.name.c_str(), text.c_str());
  }
}

/// "all" skips methods that this build does not have, with a message.
void warnOfMissingMethods(const Arguments& arguments) {
  const std::vector<std::string>& names = arguments.methods;
  if (std::find(names.begin(), names.end(), "all") == names.end()) return;
  for (const Method& method : knownMethods(arguments)) {
    if (method.unavailable.empty()) continue;
    std::fprintf(stderr, "ktgp_evaluate: method %s is left out: %s\n", method.name.c_str(),
                 method.unavailable.c_str());
  }
}

/// Distributes the pairs over the jobs; the scores have the order of the pairs.
std::vector<PairScore> evaluatePairs(const Arguments& arguments,
                                     const std::vector<ImagePair>& pairs) {
  std::vector<PairScore> scores(pairs.size());
  std::atomic<std::size_t> next{0};
  tools::ProgressBar progress(pairs.size());
  const auto work = [&] {
    PairEvaluator evaluator(arguments.pipeline.orb, wantedMethods(arguments), arguments.repeat,
                            arguments.size, arguments.truth_deviation);
    for (std::size_t i = next++; i < pairs.size(); i = next++) {
      scores[i] = evaluator.evaluate(pairs[i]);
      progress.advance(pairs[i].set + " " + pairs[i].name);
    }
  };
  // All jobs are joined in any case; then an exception of a job is rethrown.
  std::vector<std::future<void>> helpers;
  for (int i = 1; i < arguments.jobs; ++i) {
    helpers.push_back(std::async(std::launch::async, work));
  }
  work();
  for (std::future<void>& helper : helpers) helper.get();
  return scores;
}

/// Returns true if no method uses the parameter. `has_two_views`: the option --two-view is given.
bool isIdle(const ParameterRow& row, const Parameters& all, bool has_two_views) {
  static const std::set<std::string> of_sequences{"search_radius", "views"};
  // The name of a method decides about these.
  static const std::set<std::string> of_methods{"mutual", "gms", "growth", "guided", "geometry"};
  if (of_sequences.count(row.name) > 0) return true;
  if (!has_two_views) return of_methods.count(row.name) > 0;
  // The matcher's parameters replace the preset slam only if they choose a two-view geometry.
  const bool replaces_preset = all.geometry != "homography";
  return !replaces_preset && row.group != "stage_1_orb" && row.name != "threads";
}

void addArguments(CLI::App& app, Arguments& arguments) {
  app.add_option("DATA", arguments.data, "image sets or lists of pairs; images with --warps")
      ->type_name("PATH");
  app.add_option("--methods", arguments.methods, "names, separated by commas, or `all`")
      ->delimiter(',')
      ->type_name("NAMES")
      ->capture_default_str();
  app.add_option("--estimator", arguments.estimator,
                 "use this one in every method that estimates a homography")
      ->check(CLI::IsMember(estimators()))
      ->type_name("NAME");
  app.add_option("--json", arguments.json,
                 "write rows, summary and options; - is the standard output")
      ->type_name("FILE");
  app.add_option("--csv", arguments.csv, "write a row per pair and method; - as above")
      ->type_name("FILE");
  app.add_option("--jobs", arguments.jobs,
                 "pairs evaluated in parallel; times are accurate only with 1")
      ->check(tools::wholeNumberIn(1, 1024))
      ->capture_default_str();
  app.add_option("--repeat", arguments.repeat, "runs of each method; the median time counts")
      ->check(tools::wholeNumberIn(1, 1000))
      ->capture_default_str();
  CLI::Option* const longest =
      app.add_option("--longest-side", arguments.size.longest_side,
                     "reduce larger images, and the truth, to this size, px; 0: never")
          ->check(tools::wholeNumberIn(0, 100000))
          ->capture_default_str();
  app.add_flag("--hpatches", arguments.hpatches,
               "the protocol of the papers on SuperGlue and LightGlue: shorter side 480 px, "
               "without the eight sequences of large images; prints the AUC beside published ones")
      ->excludes(longest);
  const char* const views = "Two views";
  CLI::Option* const two_view =
      app.add_flag("--two-view", arguments.two_view,
                   "relative pose in scenes with depth: AUC of the larger error of rotation and "
                   "direction at 1, 2, 5 and 10 degrees; preset slam with 4000 keypoints, as in "
                   "ktgp_match, unless others are given")
          ->group(views);
  app.add_option("--apart", arguments.apart,
                 "pairs of images so many rows of cameras.txt apart, where no pairs.txt lists them")
      ->delimiter(',')
      ->check(tools::wholeNumberIn(1, 1000))
      ->needs(two_view)
      ->default_str("1")
      ->group(views);
  app.add_option("--truth-deviation", arguments.truth_deviation,
                 "standard deviation of the true homographies at the corners, px; added to the "
                 "covariances that are compared with them")
      ->check(tools::numberIn({0.0, 100.0}))
      ->capture_default_str();
  app.add_flag("--list-methods", arguments.list_methods, "list the methods and exit");
  const char* const warps = "Warps";
  CLI::Option* const warped =
      app.add_option("--warps", arguments.warps,
                     "make pairs from images: tiny, small, medium, large or extreme, or several "
                     "separated by commas")
          ->type_name("NAMES")
          ->group(warps);
  for (const char* unused : {"--longest-side", "--hpatches"}) {
    warped->excludes(app.get_option(unused));
  }
  app.add_option("--warp-pairs", arguments.warp_pairs, "pairs of each kind; half are degraded")
      ->needs(warped)
      ->check(tools::wholeNumberIn(1, 1000000))
      ->capture_default_str()
      ->group(warps);
  app.add_option("--warp-seed", arguments.warp_seed, "another seed makes other pairs")
      ->needs(warped)
      ->capture_default_str()
      ->group(warps);
  // The evaluation of two views has a table of its own, which does not use these options.
  for (const char* unused :
       {"--estimator", "--json", "--jobs", "--repeat", "--longest-side", "--hpatches",
        "--truth-deviation", "--warps", "--warp-pairs", "--warp-seed"}) {
    two_view->excludes(app.get_option(unused));
  }
  app.add_option("--bag", arguments.bag)->group("");  // hidden; recordings have their own program
  tools::addCommonOptions(app, arguments.force);
  tools::addPipelineOptions(app, arguments.pipeline,
                            [&](const ParameterRow& row, const Parameters& all) {
                              return isIdle(row, all, arguments.two_view);
                            });
}

Dataset findPairs(const Arguments& arguments) {
  Dataset dataset;
  std::istringstream names(arguments.warps);
  for (std::string name; std::getline(names, name, ',');) {
    dataset.problems.clear();  // all kinds use the same images and have the same problems
    addWarps(name, arguments.data, arguments.warp_pairs, arguments.warp_seed, dataset);
  }
  if (!arguments.warps.empty()) return dataset;
  for (const std::string& path : arguments.data) addPairs(path, dataset);
  if (arguments.hpatches) hpatches::leaveOutLarge(dataset);
  if (dataset.pairs.empty() && dataset.problems.empty()) {
    dataset.problems.emplace_back("--hpatches leaves out all of these sequences, of large images");
  }
  return dataset;
}

std::string tableOf(const Arguments& arguments, const std::vector<PairScore>& scores) {
  const std::vector<SetSummary> summaries = summarizeSets(scores);
  return arguments.hpatches ? hpatches::toTable(summaries) : toTable(summaries);
}

/// `read`: the files that DATA refers to.
void checkFiles(files::OutputPlan& plan, const std::vector<std::string>& read,
                const Arguments& arguments) {
  for (const std::string& file : read) plan.read(file);
  plan.write(arguments.json);
  plan.write(arguments.csv);
}

int evaluateImageSets(files::OutputPlan& plan, const Arguments& arguments) {
  wantedMethods(arguments);  // refuses an unknown name or a bad threshold before any work
  warnOfMissingMethods(arguments);
  Dataset dataset = findPairs(arguments);
  checkFiles(plan, dataset.files, arguments);
  const std::vector<PairScore> scores = evaluatePairs(arguments, dataset.pairs);
  for (const PairScore& score : scores) {
    if (!score.problem.empty()) dataset.problems.push_back(score.problem);
    for (const MethodScore& method : score.methods) {
      if (method.problem.empty()) continue;
      dataset.problems.push_back(score.pair.set + " " + score.pair.name + ": " + method.method +
                                 " failed: " + method.problem);
    }
  }

  const bool to_output =
      files::isStandardOutput(arguments.json) || files::isStandardOutput(arguments.csv);
  if (!to_output) std::fputs(tableOf(arguments, scores).c_str(), stdout);
  files::Outputs outputs(arguments.force);
  if (!arguments.json.empty()) {
    nlohmann::json out = toJson(scores);
    out["options"] = tools::toJson(arguments.pipeline);
    out["problems"] = dataset.problems;
    if (!arguments.warps.empty()) {
      out["warps"] = {{"kinds", arguments.warps},
                      {"pairs", arguments.warp_pairs},
                      {"seed", arguments.warp_seed}};
    }
    outputs.writeText(arguments.json, tools::textOf(out, 1));
  }
  if (!arguments.csv.empty()) outputs.writeText(arguments.csv, toCsv(scores));
  outputs.commit();
  for (const std::string& problem : dataset.problems) {
    std::fprintf(stderr, "ktgp_evaluate: %s\n", problem.c_str());
  }
  return dataset.problems.empty() ? tools::kExitDone : tools::kExitUnusedData;
}

int evaluateTwoViews(files::OutputPlan& plan, const Arguments& arguments) {
  Dataset dataset;
  std::vector<std::string>& problems = dataset.problems;
  std::vector<two_view::PosePair> pairs;
  std::vector<std::vector<two_view::PoseScore>> scores;
  two_view::PoseEvaluator evaluator(arguments.pipeline, arguments.methods);
  for (const std::string& folder : arguments.data) {
    try {
      const auto found = two_view::findPosePairs(
          folder, arguments.apart.empty() ? std::vector<int>{1} : arguments.apart, dataset);
      if (!arguments.apart.empty() && std::filesystem::exists(folder + "/pairs.txt")) {
        std::fprintf(stderr, "ktgp_evaluate: %s/pairs.txt lists the pairs: --apart has no effect\n",
                     folder.c_str());
      }
      pairs.insert(pairs.end(), found.begin(), found.end());
    } catch (const files::FileError& error) {
      problems.emplace_back(error.what());
    }
  }
  checkFiles(plan, dataset.files, arguments);
  tools::ProgressBar progress(pairs.size());
  for (const auto& pair : pairs) {
    try {
      scores.push_back(evaluator.evaluate(pair));
    } catch (const std::exception& error) {
      problems.push_back(pair.set + " " + pair.name + ": " + error.what());
      scores.emplace_back();
    }
    progress.advance(pair.set + " " + pair.name);
  }
  if (!files::isStandardOutput(arguments.csv)) {
    std::fputs(two_view::toTable(pairs, scores, arguments.methods).c_str(), stdout);
  }
  if (!arguments.csv.empty()) {
    files::writeText(arguments.csv, two_view::toCsv(pairs, scores, arguments.methods),
                     arguments.force);
  }
  for (const std::string& problem : problems) {
    std::fprintf(stderr, "ktgp_evaluate: %s\n", problem.c_str());
  }
  return problems.empty() ? tools::kExitDone : tools::kExitUnusedData;
}

int evaluate(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(kDescription);
  app.footer(kExamples);
  addArguments(app, arguments);
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  if (arguments.hpatches) {
    arguments.size.shortest_side = hpatches::kShortestSide;
    if (app.get_option("--methods")->count() == 0) arguments.methods = hpatches::methodNames();
  }
  if (arguments.two_view && app.get_option("--methods")->count() == 0) {
    arguments.methods = two_view::methodNames();
  }
  if (arguments.two_view && app.count("--preset") + app.count("--params") == 0) {
    OrbOptions& orb = arguments.pipeline.orb;  // as ktgp_match extracts features with preset slam
    if (app.count("--distribution") == 0) orb.distribution = KeypointDistribution::uniform;
    if (app.count("--features") == 0) orb.max_features = 4000;
  }
  cv::setNumThreads(1);  // the jobs use the cores
  if (arguments.list_methods) {
    listMethods(arguments);
    return 0;
  }
  if (!arguments.bag.empty()) {
    throw std::invalid_argument("--bag is a program of its own; expected ktgp_evaluate_bag " +
                                arguments.bag);
  }
  if (arguments.data.empty()) throw std::invalid_argument("DATA is required; see --help");
  files::OutputPlan plan = tools::planOutputs(app, arguments.force);
  tools::exitWhenInterrupted();
  return arguments.two_view ? evaluateTwoViews(plan, arguments)
                            : evaluateImageSets(plan, arguments);
}

}  // namespace
}  // namespace ktgp_orb::evaluation

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_evaluate",
                                     [&] { return ktgp_orb::evaluation::evaluate(argc, argv); });
}
