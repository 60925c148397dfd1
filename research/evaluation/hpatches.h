#pragma once

#include <string>
#include <vector>

#include "evaluation/dataset.h"
#include "evaluation/methods.h"
#include "evaluation/output.h"

/// The evaluation of homographies on HPatches (Balntas et al., CVPR 2017) as the papers on
/// SuperGlue (CVPR 2020) and LightGlue (ICCV 2023) do it: image 1 against 2 to 6 of each sequence,
/// the shorter side resized to 480 px, AUC of the mean corner error at 1, 3 and 5 px.
namespace ktgp_orb::evaluation::hpatches {

constexpr int kShortestSide = 480;  ///< px

/// Removes the pairs of the eight sequences with large images, which these papers leave out.
void leaveOutLarge(Dataset& dataset);

/// The methods of the table: the presets, and classical features.
std::vector<std::string> methodNames();

/// The peer SIFT with PROSAC instead of MAGSAC++, as "SIFT+PROSAC".
Method siftWithOurEstimator(const PipelineOptions& options);

/// The measured AUC over all pairs, then published values, which are marked as quoted.
std::string toTable(const std::vector<SetSummary>& summaries);

}  // namespace ktgp_orb::evaluation::hpatches
