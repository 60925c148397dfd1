#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"
#include "targets/target_index.h"
#include "targets/target_picture.h"

namespace ktgp_orb::targets {

struct StoredTarget {
  std::string id;
  double width = 0.0;
  std::string frame;
  std::string ambiguity;                ///< ambiguityOf() the first ambiguous picture
  std::vector<std::uint32_t> pictures;  ///< numbers in the store
};

/// All targets, their pictures, and the index of their keypoints.
class TargetStore {
 public:
  explicit TargetStore(const TargetFinderOptions& options) : options_(options) {}

  /// Makes the pictures of `target` with `views` views each; add() expects the number of the
  /// options. Throws std::invalid_argument with the reason if they cannot be targets.
  std::vector<TargetPicture> prepare(const Target& target, int views) const;
  StoredTarget& add(const Target& target, std::vector<TargetPicture> pictures);
  void remove(const StoredTarget& target);

  StoredTarget* find(const std::string& id);
  const std::vector<std::unique_ptr<StoredTarget>>& targets() const { return targets_; }

  TargetPicture& picture(std::uint32_t number) { return *pictures_[number]; }
  StoredTarget& owner(std::uint32_t number) { return *pictures_[number]->owner; }
  std::size_t pictureCount() const { return count_; }
  TargetIndex& index() { return index_; }

 private:
  /// The first of `count` successive free numbers.
  std::uint32_t freeNumbers(std::size_t count) const;

  const TargetFinderOptions& options_;
  std::vector<std::unique_ptr<StoredTarget>> targets_;
  std::vector<std::unique_ptr<TargetPicture>> pictures_;  // by number; null: removed
  std::size_t count_ = 0;
  TargetIndex index_;
};

}  // namespace ktgp_orb::targets
