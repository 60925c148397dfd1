// Motion statistics with arbitrary keypoints, also beyond the border and NaN.
#include <algorithm>

#include "dense_gms.h"
#include "input.h"

namespace ktgp_orb::fuzz {
namespace {

using util::Random;

std::vector<Correspondence> correspondences(Input& in, const Features& reference,
                                            const Features& target) {
  std::vector<Correspondence> all;
  if (reference.empty() || target.empty()) return all;
  Random random(in.ConsumeIntegral<std::uint16_t>());
  const bool in_order = in.ConsumeBool();
  const bool wrong = in.ConsumeIntegralInRange(0, 31) == 0;
  for (std::size_t t = 0; t < target.size(); ++t) {
    const auto r =
        in_order ? t % reference.size() : random.below(static_cast<unsigned>(reference.size()));
    all.push_back({static_cast<std::int32_t>(r), static_cast<std::int32_t>(t), 10, 20,
                   random.below(8) == 0 ? Level::knn : Level::kt, false});
  }
  if (wrong) all.back().reference_index = in.ConsumeIntegral<std::int32_t>();
  return all;
}

/// Whether the dense tables are fast enough.
bool haveSmallTables(const GmsOptions& options) {
  constexpr int kMost = 1000000;  // entries to clear and scan
  const int cells = std::min(kMost, options.grid_columns * options.grid_rows);
  const int scaled = options.scale ? 8 : 1;
  return cells <= kMost / cells / (options.rotation ? 8 : 1) / scaled / 4;
}

void run(Input& in) {
  GmsOptions options = matcherOptions(in).gms;
  options.enabled = in.ConsumeIntegralInRange(0, 31) != 0;
  const Features reference = features(in, 300);
  const Features target = features(in, 300);
  const auto before = correspondences(in, reference, target);
  auto after = before;
  GmsFilter filter(options);
  const GmsResult result = filter.filter(reference, target, after);
  std::size_t part = 0, kept = 0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    part += before[i].level == Level::kt ? 1 : 0;
    kept += after[i].level == Level::ktg ? 1 : 0;
    require(after[i].level == before[i].level ||
                (before[i].level == Level::kt && after[i].level == Level::ktg),
            "levels are raised from kt to ktg alone");
  }
  require(kept == result.kept, "as many as it says");
  require(part == result.kept + result.outside_grid + result.not_best_pair + result.low_support,
          "each is in exactly one count");
  if (!options.enabled || !isWithin(reference) || !isWithin(target) || !haveSmallTables(options)) {
    return;
  }
  std::vector<Correspondence> taking_part;
  for (const Correspondence& c : before) {
    if (c.level == Level::kt) taking_part.push_back(c);
  }
  test::DenseGms dense(options);
  const auto mask = dense.mask(reference, target, taking_part);
  std::size_t next = 0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    if (before[i].level != Level::kt) continue;
    require((after[i].level == Level::ktg) == (mask[next++] == 1), "equal to the dense tables");
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

KTGP_ORB_FUZZ(ktgp_orb::fuzz::run)  // an index outside its frame
