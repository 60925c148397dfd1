#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

namespace ktgp_orb::files {

/// Checks the files that a program reads and writes before the program begins its work. Refuses an
/// output if it exists (unless `force`), is not a regular file, is the value of another option, is
/// an input or another output (after following links), or cannot be created.
class OutputPlan {
 public:
  /// Options of the command line, each with its value.
  using Given = std::vector<std::pair<std::string, std::string>>;

  /// `given`: all options of the command line, so that no option that reads a file is forgotten.
  /// Values that are not files do no harm.
  OutputPlan(bool force, Given given) : force_(force), given_(std::move(given)) {}

  /// Registers an input that is not the value of an option, but comes from a list or a pattern.
  void read(const std::string& input);
  /// Checks and registers an output; "-" is the standard output, and an empty path is ignored.
  /// Throws FileError.
  void write(const std::string& output);
  /// Like write(), but for a picture or a video. Also throws FileError if the file name has no
  /// ending or one that cannot be written.
  void writeImage(const std::string& output);
  void writeVideo(const std::string& output);

 private:
  void refuseInputs(const std::string& output) const;

  bool force_;
  Given given_;
  std::vector<std::string> inputs_;
  std::vector<std::string> outputs_;  ///< paths as the caller gave them
};

/// An output file that is written under a temporary name and gets its final name only when it is
/// complete and on the disk. A temporary file left by a killed program is used again; a lock
/// distinguishes it from a file that another program is writing.
class OutputFile {
 public:
  /// `force`: the output may replace a file. Throws FileError if the file cannot be written.
  OutputFile(const std::string& path, bool force);
  /// Removes the file unless it was committed.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  const std::string& path() const { return path_; }
  /// The temporary path. Write the file there before commit().
  const std::string& unfinished() const { return unfinished_; }
  /// Gives the file its final name. Throws FileError, for example if the name exists and `force` is
  /// false.
  void commit() { commit({this}); }

 private:
  friend class Outputs;
  static void commit(const std::vector<OutputFile*>& files);
  void place();
  void takeBack() noexcept;
  void finish();

  std::string path_;  ///< path as the caller gave it
  bool force_;
  std::string target_;  ///< path with links resolved
  std::string unfinished_;
  int lock_ = -1;           ///< descriptor of the locked file
  bool is_placed_ = false;  ///< the final name exists and is new, so takeBack() can remove it
};

/// The output files of a run, which get their final names together at its end. If the program is
/// killed while it names the files, a file that already has its final name still has its temporary
/// name, too. isInterrupted() detects this leftover name, and the next run may replace the file
/// without --force.
class Outputs {
 public:
  explicit Outputs(bool force) : force_(force) {}

  /// Adds a file to write; the destructor removes it unless it was committed. Throws FileError.
  OutputFile& add(const std::string& path);
  /// Marks the file as complete. commit() names the files in the order of their completion.
  void complete(OutputFile& file) { complete_.push_back(&file); }
  /// The next two functions write a file and mark it as complete, or throw FileError. writeText()
  /// can also write to the standard output.
  void writeText(const std::string& path, const std::string& text);
  void writeImage(const std::string& path, const cv::Mat& image);
  /// Gives all complete files their final names, or none of them. The temporary name of the last
  /// file is removed only when all files have their final names. Throws FileError.
  void commit();

 private:
  bool force_;
  std::vector<std::unique_ptr<OutputFile>> files_;
  std::vector<OutputFile*> complete_;
};

/// Whether the file is from a run that was killed while it gave its files their final names.
bool isInterrupted(const std::string& path);

/// Whether the output is "-", which means the standard output.
bool isStandardOutput(const std::string& output);

/// Throws FileError with the reason why the file cannot be written. Image libraries give no reason,
/// so this function tries to write. `otherwise`: the reason to give if this attempt succeeds.
[[noreturn]] void throwUnwritable(const OutputFile& file, const std::string& otherwise);

/// The following functions throw FileError, for example if the disk is full; an existing file is
/// then unchanged. writeText() can also write to the standard output.
void writeText(const std::string& file, const std::string& text, bool force);
/// Writes the bytes to the temporary file without committing it.
void write(const OutputFile& file, const std::string& bytes);
/// The ending of the name selects the format. The overload for an OutputFile does not commit it.
void writeImage(const OutputFile& file, const cv::Mat& image);
void writeImage(const std::string& file, const cv::Mat& image, bool force);

}  // namespace ktgp_orb::files
