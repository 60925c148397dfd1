// Files of homographies and lists of pairs.
#include <Eigen/LU>

#include "evaluation/dataset.h"
#include "files/input.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace ktgp_orb;
  using fuzz::require;
  const fuzz::MemoryFile file(bytes, size);
  try {
    const Eigen::Matrix3d homography = files::readHomography(file.path());
    require(homography.allFinite() && homography.determinant() != 0.0, "H can be inverted");
  } catch (const files::FileError&) {
  }
  evaluation::Dataset dataset;
  evaluation::addPairs(file.path(), dataset);
  std::size_t lines = 1;
  for (std::size_t i = 0; i < size; ++i) lines += bytes[i] == '\n' ? 1 : 0;
  require(dataset.pairs.size() + dataset.problems.size() <= lines, "a line is a pair or a problem");
  return 0;
}
