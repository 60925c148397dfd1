#pragma once

#include <ktgp_orb/SetTarget.h>

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "files/output_file.h"
#include "files/target_list.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb {

/// The targets of the nodelet: from a folder or a list, and from services; kept in a file. Not for
/// several threads.
class TargetBook {
 public:
  /// Calls a function with the TargetFinder that gets the targets, and throws what it throws.
  using UseFinder = std::function<void(const std::function<void(TargetFinder&)>&)>;

  explicit TargetBook(UseFinder use_finder) : use_finder_(std::move(use_finder)) {}
  ~TargetBook();
  TargetBook(const TargetBook&) = delete;
  TargetBook& operator=(const TargetBook&) = delete;

  /// Reads the list: `file` if it exists and has contents, else `targets`; either may be empty.
  /// Then loadNext() adds the targets one by one. Until its end, no other book can open `file`.
  /// Throws std::invalid_argument with the reason if the list cannot be read, if another book has
  /// it, or if the folder for its images cannot be created.
  void open(const std::string& targets, const std::string& file);
  /// The kept list, without links; empty: none.
  const std::string& file() const { return file_; }
  bool isLoading() const { return !lists_.waiting.empty(); }
  std::size_t waiting() const { return lists_.waiting.size(); }
  /// Reads the next target of the list and adds it.
  void loadNext();
  /// How many targets of the list are refused, and the reason for one of them; empty: none is.
  std::string refusal() const;

  /// Whether one of the targets has a frame for tf.
  bool hasFrames() const;

  /// They throw std::invalid_argument or RefusedImage with the reason, and then change neither the
  /// targets nor the kept list.
  void add(const SetTarget::Request& request);
  void replace(const SetTarget::Request& request);
  void remove(const std::string& id);

 private:
  struct Lists {
    std::vector<TargetEntry> used;
    std::vector<TargetEntry> refused;  // they stay in the kept list
    std::deque<TargetEntry> waiting;   // still to be read

    /// Targets with this id that are no longer there.
    std::vector<TargetEntry> takeOut(const std::string& id);
  };

  void set(const SetTarget::Request& request, void (TargetFinder::*use)(const Target&));
  void writeImages(const Target& target, std::vector<std::string>& files) const;
  void lock();
  /// The new list, beside the kept one, which it replaces by its commit(); empty if none is kept.
  std::unique_ptr<files::OutputFile> writtenBeside(const Lists& lists) const;
  void deleteImages(const std::vector<TargetEntry>& of) const;
  void deleteAllBut(const std::vector<TargetEntry>& entries) const;

  UseFinder use_finder_;
  std::string file_;
  int lock_ = -1;  // the folder of the images, open
  Lists lists_;
  std::map<std::string, std::string> reasons_;  // reasons of refused targets, by id
};

}  // namespace ktgp_orb
