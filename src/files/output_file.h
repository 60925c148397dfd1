#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

namespace ktgp_orb::files {

/// The files that a program reads and writes, checked before any work. An output is refused if it
/// exists (unless `force`), is not a regular file, is named by another option, is one of the inputs
/// or another output (links followed), or cannot be created.
class OutputPlan {
 public:
  /// Options of the command line, each with a value that was given to it.
  using Given = std::vector<std::pair<std::string, std::string>>;

  /// `given`: all of them, so that no option that reads a file is forgotten. A value that is no
  /// file does no harm.
  OutputPlan(bool force, Given given) : force_(force), given_(std::move(given)) {}

  /// A file that the command line does not name itself: one of a list, or that fits a pattern.
  void read(const std::string& input);
  /// Throws FileError. An empty path means no output, "-" the standard output.
  void write(const std::string& output);
  /// The same for pictures and videos; also refuses an unknown ending.
  void writeImage(const std::string& output);
  void writeVideo(const std::string& output);

 private:
  void refuseInputs(const std::string& output) const;

  bool force_;
  Given given_;
  std::vector<std::string> inputs_;
  std::vector<std::string> outputs_;  ///< links resolved
};

/// A file that gets its name only when it is complete and on the disk: it is written under a
/// temporary name beside it. A file that a killed program left there is used again; a lock
/// distinguishes it from one that is being written.
class OutputFile {
 public:
  /// `force`: it may replace an existing file. Throws FileError if the file cannot be written.
  OutputFile(const std::string& path, bool force);
  /// Removes the file unless it was committed.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  const std::string& path() const { return path_; }
  /// Where to write before commit().
  const std::string& unfinished() const { return unfinished_; }
  /// Throws FileError; without `force` also if the name exists by now.
  void commit() { commit({this}); }

 private:
  friend class Outputs;
  static void commit(const std::vector<OutputFile*>& files);
  void place();
  void takeBack() noexcept;
  void finish();

  std::string path_;  ///< as given
  bool force_;
  std::string target_;  ///< links resolved
  std::string unfinished_;
  int lock_ = -1;           ///< open file
  bool is_placed_ = false;  ///< it has its name, and can be taken back
};

/// The files of a run, which get their names together at its end. If the program is killed
/// meanwhile, a file has its temporary name as well: isInterrupted() detects that, and the next run
/// replaces the file.
class Outputs {
 public:
  explicit Outputs(bool force) : force_(force) {}

  /// A file to be written; it is removed with this object unless it is complete. Throws FileError.
  OutputFile& add(const std::string& path);
  /// Marks the file as complete: commit() names it after those completed before.
  void complete(OutputFile& file) { complete_.push_back(&file); }
  /// Both add a complete file. A text may go to the standard output. Throw FileError.
  void writeText(const std::string& path, const std::string& text);
  void writeImage(const std::string& path, const cv::Mat& image);
  /// All complete files get their names, or none. The temporary name of the last one goes only when
  /// the run is done. Throws FileError.
  void commit();

 private:
  bool force_;
  std::vector<std::unique_ptr<OutputFile>> files_;
  std::vector<OutputFile*> complete_;
};

/// Whether the file is of a run that was killed while its files got their names.
bool isInterrupted(const std::string& path);

/// "-", the name of the standard output among outputs.
bool isStandardOutput(const std::string& output);

/// Throws FileError with the reason why the file cannot be written. Libraries give no reason, so it
/// tries to write; `otherwise`: the reason if that succeeds.
[[noreturn]] void throwUnwritable(const OutputFile& file, const std::string& otherwise);

/// All throw FileError, also for a full disk; then an existing file is unchanged. A text may go to
/// the standard output.
void writeText(const std::string& file, const std::string& text, bool force);
/// The bytes of the file, without commit.
void write(const OutputFile& file, const std::string& bytes);
/// The ending of the name selects the format. The overload for an OutputFile does not commit it.
void writeImage(const OutputFile& file, const cv::Mat& image);
void writeImage(const std::string& file, const cv::Mat& image, bool force);

}  // namespace ktgp_orb::files
