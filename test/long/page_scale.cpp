// Scanned pages, facades and circuit boards that repeat themselves: pairs that share only their
// symbols, of which none may be found, and pairs that share 30 % of their width. Run by
// `ctest -L long`.
//   page_scale PAIRS SEED: so many of each.
// Fails where one of the former is found, or one of the latter is wrong, or fewer than 95 % of
// these are found.

#include <cstdio>
#include <cstdlib>

#include "drawn_pages.h"

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "page_scale PAIRS SEED\n");
    return 2;
  }
  using namespace ktgp_orb::test;
  const std::uint64_t first = std::strtoull(argv[2], nullptr, 10);
  const std::uint64_t last =
      first + (std::strtoull(argv[1], nullptr, 10) + kPages.size() - 1) / kPages.size();
  bool right = true;
  for (const Scan& second : {Scan{}, fineScan(), nearPhotograph()}) {
    const PageCounts apart = countPages(0.0, first, last, second);
    const PageCounts related = countPages(0.3, first, last, second);
    std::printf("zoom %.2f, only symbols in common: %d of %d found\n", second.zoom, apart.found,
                apart.pairs);
    std::printf("zoom %.2f, 30 %% in common: %d of %d found, %d wrong\n", second.zoom,
                related.found, related.pairs, related.wrong);
    std::fflush(stdout);
    const bool is_same_scale = second.zoom == 1.0;
    right = right && apart.found == 0 && related.wrong == 0 &&
            (!is_same_scale || related.found >= 0.95 * related.pairs);
  }
  const PageCounts apart = countPages(0.0, first, last, Scan{}, kHeldBackPages);
  std::printf("held back, only symbols in common: %d of %d found\n", apart.found, apart.pairs);
  right = right && apart.found == 0;
  return right ? 0 : 1;
}
