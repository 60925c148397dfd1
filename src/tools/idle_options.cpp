#include "tools/idle_options.h"

#include <map>
#include <stdexcept>
#include <string>

namespace ktgp_orb {

void refuseIdleOptions(const CLI::App& app, const Parameters& parameters) {
  std::map<std::string, std::string> idle{{"lazy", "ktgp_bag matches every image"},
                                          {"max_latency", "it is for the diagnostics of the node"}};
  if (parameters.reference_mode != "fixed" && !parameters.reference_image.empty()) {
    idle["reference_image"] = "it is used only with --reference_mode fixed";
  }
  if (app.get_option("--targets")->count() == 0) {
    idle["calibration"] = "it is used only for the pose of --targets";
  }
  if (app.get_option("--overlay")->count() == 0)
    idle["overlay_style"] = "it is used only with --overlay";
  for (const auto& [name, reason] : idle) {
    if (app.get_option("--" + name)->count() == 0) continue;
    std::string text = "--" + name;
    text.append(" has no effect: ").append(reason).append("; leave it out");
    throw std::invalid_argument(text);
  }
  if (parameters.reference_mode == "fixed" && parameters.reference_image.empty()) {
    throw std::invalid_argument(
        "reference_mode is fixed, and there is no reference; expected --reference_image FILE");
  }
}

}  // namespace ktgp_orb
