#include "tools/batch_options.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <thread>

#include "tools/bag_targets.h"
#include "tools/manifest.h"

namespace ktgp_orb {
namespace {

std::string contentOf(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Every option with its value, and every parameter, whether from the command line, a file or a
/// preset. The number of threads changes nothing.
std::string describe(const CLI::App& app, const Parameters& parameters) {
  std::string text = app.config_to_str(true, false);
  for (const ParameterRow& row : parameterRows()) {
    if (row.name != "threads") text += row.name + '=' + valueText(row, parameters) + '\n';
  }
  text += contentOf(parameters.reference_image) + contentOf(parameters.mask_image);
  const CLI::Option* const targets = app.get_option("--targets");
  if (targets->count() > 0) {
    for (const std::string& file : filesOfTargets(targets->as<std::string>())) {
      text += file + '\n' + contentOf(file);
    }
  }
  return text;
}

}  // namespace

void addBatchOptions(CLI::App& app, BatchOptions& options) {
  const char* const group = "Many recordings";
  CLI::Option* const list =
      app.add_option(
             "--batch", options.list,
             "process every recording that this file names, one per line, into the folder "
             "that is the only other name: ktgp_bag --batch LIST FOLDER. The files of each, "
             "matched.bag and those of the other options, are in a folder of its own. "
             "Finished ones are skipped; summary.csv has a line for each")
          ->type_name("LIST")
          ->group(group);
  options.jobs = 0;
  app.add_option("--jobs", options.jobs, "recordings processed in parallel; 0: one per core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str()
      ->needs(list)
      ->group(group);
  app.add_option_function<std::string>(
         "--part",
         [&options](const std::string& text) {
           try {
             setPart(text, options);
           } catch (const std::invalid_argument& error) {
             throw CLI::ValidationError("--part", error.what());
           }
         },
         "only the recordings K, K + N, ...: for several machines; without summary.csv")
      ->type_name("K/N")
      ->needs(list)
      ->group(group);
}

void completeBatchOptions(CLI::App& app, const Parameters& parameters, BatchOptions& options) {
  for (const char* name :
       {"--csv", "--stabilize", "--stabilizer_warps", "--mosaic", "--mosaic_poses", "--motion"}) {
    const CLI::Option* const option = app.get_option(name);
    if (option->count() == 0) continue;
    const std::string file = option->as<std::string>();
    if (file == "-" || file.find('/') != std::string::npos) {
      throw std::invalid_argument(std::string(name) + " is " + file +
                                  "; in a batch, expected a name for the folder of each recording");
    }
  }
  for (const char* name : {"--batch", "--jobs", "--part", "--threads", "--force", "--params"}) {
    app.get_option(name)->configurable(false);
  }
  options.parameters = hashOf(describe(app, parameters));
  if (options.jobs == 0) {
    options.jobs = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  }
}

}  // namespace ktgp_orb
