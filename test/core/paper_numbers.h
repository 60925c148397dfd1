#pragma once

#include <array>
#include <cstddef>
#include <ostream>

namespace ktgp_orb::test {

/// Matches left after each stage for one image pair.
struct PaperPair {
  int target_image;  ///< matched to image 1 of its set
  std::size_t kt;
  std::size_t ktg;
  std::size_t ktgp;
};

/// Mean and RMS Hamming distance of the matches, averaged over a set's five pairs.
struct PaperDistance {
  double mean;
  double rms;
};

struct PaperSet {
  const char* name;  ///< folder of the Oxford data
  std::array<PaperPair, 5> pairs;
  PaperDistance kt;
  PaperDistance ktg;
  PaperDistance ktgp;
};

/// For GoogleTest's messages.
inline void PrintTo(const PaperSet& set, std::ostream* out) {
  *out << set.name;
}

/// Results of the method on the paper's own image pairs (its Tables 3 to 5) with cv::ORB at 2000
/// features and exact search. KT and KTG follow from exact rules; KTGP, here with OpenCV's PROSAC,
/// depends on the estimator's samples and refinement.
inline const std::array<PaperSet, 2> kPaperSets{{
    {"leuven",
     {{{2, 812, 763, 743},
       {3, 599, 526, 510},
       {4, 501, 432, 415},
       {5, 423, 367, 357},
       {6, 332, 283, 272}}},
     {23.676, 25.242},
     {23.789, 25.362},
     {23.574, 25.145}},
    {"bikes",
     {{{2, 991, 910, 890},
       {3, 840, 774, 746},
       {4, 463, 423, 394},
       {5, 330, 302, 267},
       {6, 197, 161, 132}}},
     {23.294, 24.770},
     {23.252, 24.718},
     {22.639, 24.085}},
}};

}  // namespace ktgp_orb::test
