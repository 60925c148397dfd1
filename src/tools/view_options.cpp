#include "tools/view_options.h"

#include <stdexcept>

#include "cli/matcher_cli.h"
#include "parameters/parameters.h"
#include "stabilization/steady_path.h"

namespace ktgp_orb {

void addViewOptions(CLI::App& app, ViewOptions& views) {
  const char* const group = "To look at";
  CLI::Option* const video =
      app.add_option("--stabilize", views.video, "write a steady video (mp4) of the images")
          ->type_name("FILE")
          ->group(group);
  CLI::Option* const lag =
      app.add_option(
             "--stabilizer_lag", views.stabilizer.lag,
             "smooth the path frame by frame as the node does, with this many later frames; "
             "without it: the steadiest path over the whole recording")
          ->check(tools::numberIn(limitsOf("stabilizer", "lag")))
          ->needs(video)
          ->group(group);
  app.add_option("--stabilizer_strength", views.stabilizer.strength,
                 "with --stabilizer_lag: faster motion is shake and is removed [s]")
      ->check(tools::numberIn(limitsOf("stabilizer", "strength")))
      ->capture_default_str()
      ->needs(lag)
      ->group(group);
  app.add_option("--stabilizer_max_crop", views.stabilizer.max_crop,
                 "share of width and height to cut off at each border")
      ->check(tools::numberIn(limitsOf("stabilizer", "max_crop")))
      ->capture_default_str()
      ->needs(video)
      ->group(group);
  app.add_option("--stabilizer_warps", views.warps,
                 "write a table with the image -> steady image homography of every image; needs "
                 "--stabilize")
      ->type_name("FILE")
      ->needs(video)
      ->group(group);
  CLI::Option* const map =
      app.add_option(
             "--mosaic", views.mosaic,
             "write the mosaic as a picture (png); further maps, after a cut for example, are in "
             "FILE-2 and so on")
          ->type_name("FILE")
          ->group(group);
  app.add_option("--mosaic_keyframes", views.map.keyframes,
                 "place frames by matches to keyframes; false: by the homographies alone")
      ->capture_default_str()
      ->needs(map)
      ->group(group);
  app.add_option("--mosaic_max_megapixels", views.map.max_megapixels,
                 "size at which the map stops growing")
      ->check(tools::numberIn(limitsOf("mosaic", "max_megapixels")))
      ->capture_default_str()
      ->needs(map)
      ->group(group);
  app.add_option("--mosaic_poses", views.mosaic_poses,
                 "write a table with the map -> frame homography of every image; needs --mosaic")
      ->type_name("FILE")
      ->needs(map)
      ->group(group);
}

void completeViewOptions(const CLI::App& app, ViewOptions& views, bool force) {
  views.force = force;
  views.whole = app.get_option("--stabilizer_lag")->count() == 0;
  if (!views.video.empty() && views.whole && !hasSteadyPath()) {
    throw std::invalid_argument(
        "--stabilize needs a solver for the path over the whole recording, and this program was "
        "built without Clp (Debian's coinor-libclp-dev); expected --stabilizer_lag N, for example "
        "30, or a build with it");
  }
}

}  // namespace ktgp_orb
