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
  std::string ambiguity;                ///< result of ambiguityOf() for the first ambiguous picture
  std::vector<std::uint32_t> pictures;  ///< numbers of the pictures in the store
};

/// All targets, their pictures, and the index of their keypoints.
class TargetStore {
 public:
  explicit TargetStore(const TargetFinderOptions& options) : options_(options) {}

  /// Makes the pictures of `target`, each with `views` views. If you pass the pictures to add(),
  /// use options.views as `views`. Throws std::invalid_argument with the reason if the images
  /// cannot be used as a target.
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
  /// Finds `count` successive free numbers, and returns the first of them.
  std::uint32_t freeNumbers(std::size_t count) const;

  const TargetFinderOptions& options_;
  std::vector<std::unique_ptr<StoredTarget>> targets_;
  // Pictures by number; null: the picture was removed.
  std::vector<std::unique_ptr<TargetPicture>> pictures_;
  std::size_t count_ = 0;
  TargetIndex index_;
};

}  // namespace ktgp_orb::targets
