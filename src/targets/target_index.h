#pragma once

#include <cstdint>
#include <vector>

#include "growth/local_frame.h"
#include "growth/reference_frames.h"
#include "targets/bit_tables.h"

namespace ktgp_orb::targets {

/// A keypoint of a picture that looks like a keypoint of the frame.
struct IndexHit {
  std::uint32_t picture;   ///< number of the picture in the store
  std::uint32_t keypoint;  ///< number of the picture's keypoint
  std::uint32_t query;     ///< number of the keypoint in the frame
  std::int32_t distance;   ///< Hamming distance of their descriptors
};

/// Index of the descriptors of all pictures. Finds the descriptors that are similar to a given one,
/// but misses a few of them.
class TargetIndex {
 public:
  /// Returns true if a picture may be added under this number. Returns false while the index still
  /// has entries of a removed picture with the same number, or if the number is in use.
  bool isFree(std::uint32_t picture) const {
    return picture >= is_used_.size() || is_used_[picture] == 0;
  }
  /// Adds a picture under a free number. The index refers to `bits`, which must neither move nor
  /// change until the picture is removed.
  void add(std::uint32_t picture, const std::vector<growth::Bits>& bits);
  void remove(std::uint32_t picture);
  /// Sorts all descriptors into one set of tables if many of them were added or removed. This takes
  /// up to a second for a thousand pictures. So it is done only if no target has changed since the
  /// last call, or if more descriptors were removed than the largest segment holds. Call it before
  /// each frame.
  void optimise();

  /// For each query, finds the most similar descriptors, at most kNearest, and appends them to
  /// `hits`. `queries`: indices into `wanted`. At equal distances, lower numbers of pictures and
  /// keypoints come first.
  void search(const std::vector<growth::Bits>& wanted, const std::vector<std::uint32_t>& queries,
              std::vector<IndexHit>& hits);

  static constexpr int kMaxDistance = 64;
  static constexpr std::size_t kNearest = 8;

 private:
  struct Entry {
    std::uint32_t picture;
    std::uint32_t keypoint;
  };
  /// Tables with the descriptors of some of the pictures.
  struct Segment {
    std::vector<Entry> entries;
    BitTables tables{48, 8};  // fullest_cell, most_other_bits
  };

  const growth::Bits& bitsOf(const Entry& entry) const {
    return (*pictures_[entry.picture])[entry.keypoint];
  }
  void mergeFrom(std::size_t first);
  void searchSegment(const Segment& segment, const std::vector<growth::Bits>& wanted,
                     const std::uint32_t* queries, std::size_t count);
  void keep(const IndexHit& hit, std::vector<IndexHit>& nearest) const;

  std::vector<const std::vector<growth::Bits>*> pictures_;  // null: removed
  // For each picture number: 1 while segments may hold entries of the picture.
  std::vector<std::uint8_t> is_used_;
  std::vector<Segment> segments_;  // sorted by size, the largest segment first
  std::size_t removed_ = 0;        // number of entries of removed pictures
  bool is_changing_ = false;       // pictures have changed since the last optimise()
  // Number of queries that are searched together, so that the processor can fetch the memory for
  // one query while it works on the others.
  static constexpr std::size_t kBlock = 32;
  BitTables::Found similar_;
  std::vector<IndexHit> nearest_[kBlock];
};

/// Pairs the keypoints of one picture with the keypoints of the frame. Reuses its buffers.
class FrameTables {
 public:
  /// `key_bits`: number of bits of a key, 8..16. Descriptors are compared only if they have an
  /// equal key. Fewer bits find more pairs and take longer.
  explicit FrameTables(int key_bits) : key_bits_(key_bits) {}

  void setFrame(const std::vector<growth::Bits>& bits);

  /// Pairs each keypoint of the frame with the most similar keypoint of the picture, if their
  /// distance is at most kMaxDistance; a few pairs are missed. The clearest pairs come first: pairs
  /// are sorted by the ratio of their distance to the distance of the most similar keypoint at
  /// another place of the picture. The pairs depend only on this picture and the frame. `number`:
  /// number of the picture in the store.
  void match(std::uint32_t number, const growth::ReferenceFrames& picture,
             std::vector<IndexHit>& pairs);

  static constexpr int kMaxDistance = 64;

 private:
  /// The most similar keypoint of the picture, for one keypoint of the frame.
  struct Nearest {
    std::uint32_t keypoint = 0;
    int distance = kMaxDistance + 1;
    int elsewhere = kMaxDistance + 1;  // distance of the most similar keypoint at another place
  };

  void keep(std::uint32_t keypoint, int distance, const growth::ReferenceFrames& picture,
            Nearest& nearest) const;

  int key_bits_;
  std::vector<growth::Bits> bits_;
  BitTables tables_{32, 10};
  BitTables::Found found_;
  std::vector<Nearest> nearest_;  // one entry per keypoint of the frame
};

}  // namespace ktgp_orb::targets
