#pragma once

#include <string>

#include "ktgp_orb/mosaic.h"
#include "ktgp_orb/stabilizer.h"

namespace CLI {
class App;
}  // namespace CLI

namespace ktgp_orb {

/// Files with views; empty names: none.
struct ViewOptions {
  std::string video;  ///< mp4, steady
  std::string warps;  ///< csv: the frame -> steady picture homography of each frame
  /// The path over the whole recording (see steadyPath), else the causal one with its lag.
  bool whole = true;
  StabilizerOptions stabilizer;
  double rate = 30.0;        ///< 1/s, of the video
  std::string mosaic;        ///< png, of the first map; mosaicOf names those of further maps
  std::string mosaic_poses;  ///< csv: the map -> frame homography of each frame
  MosaicOptions map;
  bool force = false;  ///< may overwrite files
};

/// Adds --stabilize, --mosaic and what belongs to them.
void addViewOptions(CLI::App& app, ViewOptions& views);
/// To be called after parsing. Throws std::invalid_argument for options that this build cannot
/// fulfil.
void completeViewOptions(const CLI::App& app, ViewOptions& views, bool force);

}  // namespace ktgp_orb
