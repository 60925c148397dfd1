#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

namespace ktgp_orb::files {

/// Pictures have 8 bits a channel.
enum class PictureKind {
  colour,       ///< BGR
  transparent,  ///< BGRA. A format without transparent parts, such as JPEG, leaves them black
};

/// Checks the files that a program reads and writes before the program begins its work. Refuses an
/// output file that exists (unless `force`), is not a regular file, cannot be created, is also the
/// value of another option, or is the same file as an input or another output, even through links.
class OutputPlan {
 public:
  /// The names and values of the options on the command line.
  using Given = std::vector<std::pair<std::string, std::string>>;

  /// `given`: all options of the command line, so that no option that reads a file is forgotten.
  /// Values that are not file names do no harm.
  OutputPlan(bool force, Given given) : force_(force), given_(std::move(given)) {}

  /// Registers an input file that is not itself the value of an option, but comes from a list or a
  /// pattern.
  void read(const std::string& input);
  /// Checks and registers an output file. "-" means the standard output; an empty path is ignored.
  /// Throws FileError.
  void write(const std::string& output);
  /// Like write(), but for a picture or a video. Also throws FileError if the file name has no
  /// extension, or an extension whose format we cannot write, or not for this kind of picture.
  void writeImage(const std::string& output, PictureKind kind = PictureKind::colour);
  void writeVideo(const std::string& output);

 private:
  void refuseInputs(const std::string& output) const;

  bool force_;
  Given given_;
  std::vector<std::string> inputs_;
  std::vector<std::string> outputs_;  ///< paths as the caller gave them
};

/// An output file that is written under a temporary name and gets its final name only when it is
/// complete and on the disk. If a killed program left a temporary file behind, we use the name of
/// that file again. A program locks the file that it is writing, so that other programs do not take
/// it for such a leftover.
class OutputFile {
 public:
  /// `force`: replace the file if it exists. Throws FileError if the file cannot be written.
  OutputFile(const std::string& path, bool force);
  /// Removes the temporary file unless commit() was called.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  const std::string& path() const { return path_; }
  /// The temporary path. The caller writes the file there and then calls commit().
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

  std::string path_;  ///< the path that the caller gave
  bool force_;
  std::string target_;  ///< the same path with links resolved
  std::string unfinished_;
  int lock_ = -1;           ///< descriptor of the temporary file, which is locked
  bool is_placed_ = false;  ///< whether takeBack() must remove the final name
};

/// All output files of a run. They get their final names together at the end of the run. If the
/// program is killed meanwhile, a file that already has its final name still has its temporary
/// name, too. isInterrupted() detects this, and the next run may replace the file without --force.
class Outputs {
 public:
  explicit Outputs(bool force) : force_(force) {}

  /// Adds a file that the caller will write. The destructor removes it unless it was committed.
  /// Throws FileError.
  OutputFile& add(const std::string& path);
  /// Marks the file as complete. commit() names the files in the order in which they were
  /// completed.
  void complete(OutputFile& file) { complete_.push_back(&file); }
  /// These two functions write a file and mark it as complete, or throw FileError. writeText()
  /// writes to the standard output if the path is "-".
  void writeText(const std::string& path, const std::string& text);
  void writeImage(const std::string& path, const cv::Mat& image);
  /// Gives all complete files their final names. If this fails for one of them, removes the new
  /// names again; files that were already replaced stay replaced. The temporary name of the last
  /// file is removed only when all files have their final names. Throws FileError.
  void commit();

 private:
  bool force_;
  std::vector<std::unique_ptr<OutputFile>> files_;
  std::vector<OutputFile*> complete_;
};

/// Returns true if the file is from a run that was killed while it gave its files their final
/// names.
bool isInterrupted(const std::string& path);

/// Returns true if the output is "-", which means the standard output.
bool isStandardOutput(const std::string& output);

/// Throws FileError with the reason why the file cannot be written. Image libraries do not tell the
/// reason, so this function tries to write to the file. `otherwise`: reason to give if writing
/// succeeds.
[[noreturn]] void throwUnwritable(const OutputFile& file, const std::string& otherwise);

/// These functions write a whole file. They throw FileError, for example if the disk is full; a
/// file that existed before is then unchanged. writeText() writes to the standard output if `file`
/// is "-".
void writeText(const std::string& file, const std::string& text, bool force);
/// Writes the bytes to the temporary file. The caller must still commit it.
void write(const OutputFile& file, const std::string& bytes);
/// Write an image in the format that belongs to the extension of the file name. After the first
/// function, the caller must still commit the file.
void writeImage(const OutputFile& file, const cv::Mat& image);
void writeImage(const std::string& file, const cv::Mat& image, bool force);

}  // namespace ktgp_orb::files
