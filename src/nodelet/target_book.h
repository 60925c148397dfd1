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

/// Manages the nodelet's targets, which come from a folder, a list or services, and keeps their
/// list in a file. Not thread-safe.
class TargetBook {
 public:
  /// Gives the TargetFinder with the targets to a function. Passes on the exceptions of that
  /// function.
  using UseFinder = std::function<void(const std::function<void(TargetFinder&)>&)>;

  explicit TargetBook(UseFinder use_finder) : use_finder_(std::move(use_finder)) {}
  ~TargetBook();
  TargetBook(const TargetBook&) = delete;
  TargetBook& operator=(const TargetBook&) = delete;

  /// Reads the list in `file` if this file exists and is not empty, or else the list in `targets`.
  /// Either name may be empty. After this, loadNext() adds the targets one by one. As long as this
  /// book exists, no other book can open `file`. Throws std::invalid_argument with the reason if
  /// the list cannot be read, if another book uses it, or if the folder for its images cannot be
  /// created.
  void open(const std::string& targets, const std::string& file);
  /// Path of the file in which the list is kept, with links resolved; empty if no list is kept.
  const std::string& file() const { return file_; }
  bool isLoading() const { return !lists_.waiting.empty(); }
  std::size_t waiting() const { return lists_.waiting.size(); }
  /// Reads the next target of the list and adds it.
  void loadNext();
  /// Number of refused targets and the reason for one of them, as text; empty if none is refused.
  std::string refusal() const;

  /// Returns true if one of the targets has a frame for tf.
  bool hasFrames() const;

  /// If one of the following functions fails, it throws std::invalid_argument or RefusedImage with
  /// the reason and changes neither the targets nor the kept list.
  void add(const SetTarget::Request& request);
  void replace(const SetTarget::Request& request);
  void remove(const std::string& id);

 private:
  struct Lists {
    std::vector<TargetEntry> used;
    std::vector<TargetEntry> refused;  // refused targets, which stay in the kept list
    std::deque<TargetEntry> waiting;   // targets that wait to be read

    /// Removes and returns the targets with this id.
    std::vector<TargetEntry> takeOut(const std::string& id);
  };

  void set(const SetTarget::Request& request, void (TargetFinder::*use)(const Target&));
  void writeImages(const Target& target, std::vector<std::string>& files) const;
  void lock();
  /// Writes the new list to another file beside the kept list. Call commit() of the result to
  /// replace the kept list. Returns null if no list is kept.
  std::unique_ptr<files::OutputFile> writtenBeside(const Lists& lists) const;
  void deleteImages(const std::vector<TargetEntry>& of) const;
  void deleteAllBut(const std::vector<TargetEntry>& entries) const;

  UseFinder use_finder_;
  std::string file_;
  int lock_ = -1;  // file descriptor of the locked image folder; -1: none
  Lists lists_;
  std::map<std::string, std::string> reasons_;  // by id: why a target was refused
};

}  // namespace ktgp_orb
