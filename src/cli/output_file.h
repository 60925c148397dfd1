#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace ktgp_orb::tools {

/// The files that a program reads and writes, checked before any work: an output is refused where
/// it exists (unless `force`), where it is no regular file, where it is one of the inputs or
/// another output (links followed), and where it cannot be made.
class OutputPlan {
 public:
  explicit OutputPlan(bool force) : force_(force) {}

  void read(const std::string& input);
  /// Throws FileError. An empty path is no output.
  void write(const std::string& output);
  /// The same, for pictures and videos: also refuses an ending that is none of theirs.
  void writeImage(const std::string& output);
  void writeVideo(const std::string& output);

 private:
  bool force_;
  std::vector<std::string> inputs_;
  std::vector<std::string> outputs_;  ///< links resolved
};

/// A file that has its name only when it is complete: it is written beside it and renamed.
class OutputFile {
 public:
  /// `force`: it may replace what has the name by then. Throws FileError where nothing can be
  /// written there.
  OutputFile(const std::string& path, bool force);
  /// Removes what was not committed.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  const std::string& path() const { return path_; }
  /// Where to write until commit().
  const std::string& unfinished() const { return unfinished_; }
  /// Throws FileError, without `force` also where something has the name by now.
  void commit();

 private:
  std::string path_;  ///< as it was given
  bool force_;
  std::string target_;  ///< links resolved
  std::string unfinished_;
};

/// Both throw FileError, for a full disk too; then the file is as it was before.
void writeText(const std::string& file, const std::string& text, bool force);
/// The ending of the name is the format. The first does not commit.
void writeImage(const OutputFile& file, const cv::Mat& image);
void writeImage(const std::string& file, const cv::Mat& image, bool force);

}  // namespace ktgp_orb::tools
