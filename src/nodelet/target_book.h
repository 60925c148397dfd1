#pragma once

#include <ktgp_orb/SetTarget.h>

#include <deque>
#include <string>
#include <vector>

#include "ktgp_orb/target_finder.h"
#include "parameters/target_list.h"

namespace ktgp_orb {

/// The targets of the nodelet: from a folder or a list, and from services; kept in a file. Not for
/// several threads.
class TargetBook {
 public:
  explicit TargetBook(TargetFinder& finder) : finder_(finder) {}

  /// Reads the list: `file` if it exists, else `targets`; either may be empty. Throws
  /// std::invalid_argument with the reason. Then loadNext() adds the targets one by one.
  void open(const std::string& targets, const std::string& file);
  bool isLoading() const { return !waiting_.empty(); }
  std::size_t waiting() const { return waiting_.size(); }
  /// Returns why it was refused, or an empty text. In the kept list it stays all the same.
  std::string loadNext();
  /// For the end of a sentence about it: where that list is; empty without one.
  std::string whereKept() const;

  /// Whether one of the targets has a frame for tf.
  bool hasFrames() const;

  /// Throw std::invalid_argument or RefusedImage with the reason, without any change of the targets
  /// in use.
  void add(const SetTarget::Request& request);
  void replace(const SetTarget::Request& request);
  void remove(const std::string& id);

 private:
  void set(const SetTarget::Request& request, bool replace);
  void keep(const Target& target);
  std::vector<std::string> writeImages(const Target& target) const;
  std::vector<TargetEntry> takeOut(const std::string& id);
  void write() const;
  void deleteImages(const std::vector<TargetEntry>& of) const;

  TargetFinder& finder_;
  std::string file_;
  std::deque<TargetEntry> waiting_;
  std::vector<TargetEntry> entries_;  // those in use
  std::vector<TargetEntry> refused_;
};

}  // namespace ktgp_orb
