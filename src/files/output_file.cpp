#include "files/output_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "files/input.h"

namespace ktgp_orb::files {
namespace {

namespace fs = std::filesystem;

/// The absolute path with all symbolic links resolved, even links to files that do not exist.
fs::path resolved(const std::string& path) {
  std::error_code error;
  fs::path target = fs::absolute(path, error);
  constexpr int kMostLinks = 40;
  for (int i = 0; i < kMostLinks && fs::is_symlink(target, error); ++i) {
    const fs::path link = fs::read_symlink(target, error);
    target = link.is_absolute() ? link : target.parent_path() / link;
  }
  const fs::path whole = fs::weakly_canonical(target, error);
  return error ? target : whole;
}

bool isSameFile(const std::string& a, const std::string& b) {
  std::error_code none;
  return resolved(a) == resolved(b) ||
         (fs::exists(a, none) && fs::exists(b, none) && fs::equivalent(a, b, none));
}

/// The extension of the file name in lower case, for example ".png" for "Map.PNG".
std::string endingOf(const std::string& path) {
  std::string ending = fs::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

/// Returns true if a picture with this ending is what it should be when it is read again. Formats
/// that OpenCV knows may be for grey values or for floats only; some, such as Sun rasters, are
/// written wrongly with four channels.
bool canBeWritten(const std::string& ending, PictureKind kind) {
  if (ending.empty()) return false;
  constexpr double kGrey = 200.0;
  constexpr double kTolerance = 5.0;  // JPEG and Radiance HDR are not exact
  constexpr int kSide = 64;           // px; JPEG 2000 cannot be much smaller
  const int type = kind == PictureKind::colour ? CV_8UC3 : CV_8UC4;
  const cv::Mat picture(kSide, kSide, type, cv::Scalar(kGrey, kGrey, kGrey, 255.0));
  try {
    std::vector<unsigned char> bytes;
    if (!cv::imencode(ending, picture, bytes)) return false;
    const cv::Mat read = cv::imdecode(bytes, cv::IMREAD_COLOR);
    const cv::Mat expected(kSide, kSide, CV_8UC3, cv::Scalar::all(kGrey));
    return read.size() == expected.size() && read.type() == expected.type() &&
           cv::norm(read, expected, cv::NORM_INF) <= kTolerance;
  } catch (const cv::Exception&) {
    return false;
  }
}

bool isSameNode(const struct stat& a, const struct stat& b) {
  return a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

/// Creates and locks a file. If the file exists and no program has locked it, locks and empties it.
/// Returns its descriptor, or -1 on failure. errno is EEXIST if the name is taken, for example by a
/// link or by a file of another program.
int lockedFile(const std::string& name) {
  int file = open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
  const bool is_new = file >= 0;
  if (!is_new && errno != EEXIST) return -1;
  if (!is_new) file = open(name.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  // Some file systems have no locks. There we use the file only if we have just created it.
  const bool is_locked =
      file >= 0 && (flock(file, LOCK_EX | LOCK_NB) == 0 || (is_new && errno != EWOULDBLOCK));
  // Another process may have renamed or removed the file before we locked it, so check that the
  // name still belongs to this file.
  struct stat opened, named;
  const bool is_ours = is_locked && fstat(file, &opened) == 0 && lstat(name.c_str(), &named) == 0 &&
                       isSameNode(opened, named) && S_ISREG(opened.st_mode) &&
                       opened.st_nlink == 1 && ftruncate(file, 0) == 0;
  if (is_ours) return file;
  if (file >= 0) close(file);
  errno = EEXIST;
  return -1;
}

/// Renames a file atomically, but fails if the new name exists. Sets errno on failure.
bool renameToNew(const char* from, const char* to) {
  constexpr unsigned kNoReplace = 1;  // RENAME_NOREPLACE; some libcs do not define it
  if (syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, kNoReplace) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;
  // Some file systems, such as NFS, do not support RENAME_NOREPLACE, but they have hard links.
  if (link(from, to) != 0) return false;
  unlink(from);
  return true;
}

/// A temporary name in the same folder. It keeps the extension, because some libraries choose the
/// format by it.
std::string unfinishedName(const fs::path& target, int number) {
  const std::string name =
      target.stem().string() + ".unfinished" + std::to_string(number) + target.extension().string();
  return (target.parent_path() / name).string();
}

constexpr int kMostNames = 1000;

/// Returns the temporary name that `target` still has beside its final name because a program was
/// killed while it gave its files their final names. Empty if there is none, or if that program is
/// still running.
std::string leftName(const std::string& target) {
  struct stat file, other;
  if (lstat(target.c_str(), &file) != 0 || !S_ISREG(file.st_mode) || file.st_nlink < 2) return {};
  for (int i = 0; i < kMostNames; ++i) {
    std::string name = unfinishedName(target, i);
    if (lstat(name.c_str(), &other) != 0 || !isSameNode(file, other)) continue;
    const int opened = open(name.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    const bool is_free = opened >= 0 && flock(opened, LOCK_EX | LOCK_NB) == 0;
    if (opened >= 0) close(opened);
    return is_free ? name : "";
  }
  return {};
}

/// Throws FileError with the text of errno.
[[noreturn]] void fail(const std::string& path) {
  throw FileError(path, std::string("cannot be written: ") + std::strerror(errno));
}

/// Flushes a file or folder to the disk. Returns false and sets errno on failure.
bool synchronised(const std::string& path, int flags) {
  const int descriptor = open(path.c_str(), flags | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool done =
      fsync(descriptor) == 0 || errno == EINVAL;  // EINVAL: no fsync on this file system
  const int error = errno;
  close(descriptor);
  errno = error;
  return done;
}

}  // namespace

void OutputPlan::read(const std::string& input) {
  if (!input.empty()) inputs_.push_back(input);
}

void OutputPlan::refuseInputs(const std::string& output) const {
  std::string options;
  std::size_t own = 0;
  std::size_t same = 0;
  for (const auto& [option, value] : given_) {
    // `same` counts the options whose value names the output file. One such option is allowed
    // (`own` is 1): the option that gives the output. If no option gives the output, `own` is 0.
    if (value == output) own = 1;
    if (!isSameFile(output, value)) continue;
    options += (same++ == 0 ? "" : " and ") + option;
  }
  if (same > own) throw FileError(output, "is the file of " + options + "; expected another file");
  for (const std::string& input : inputs_) {
    if (isSameFile(output, input)) {
      throw FileError(output, "is the input " + input + "; expected another file");
    }
  }
}

void OutputPlan::write(const std::string& output) {
  if (output.empty()) return;
  if (isStandardOutput(output)) {
    if (std::count(outputs_.begin(), outputs_.end(), output) > 0) {
      throw FileError(output, "is an output already: the standard output; expected a file");
    }
    outputs_.push_back(output);
    return;
  }
  for (const std::string& other : outputs_) {
    if (!isStandardOutput(other) && isSameFile(output, other)) {
      throw FileError(output, "is an output already (" + other + "); expected another file");
    }
  }
  refuseInputs(output);
  std::error_code error;
  const fs::path target = resolved(output);
  const fs::file_status status = fs::status(target, error);
  if (fs::exists(status)) {
    if (!fs::is_regular_file(status)) {
      throw FileError(output, "is not a regular file; expected a file or a new name");
    }
    const bool may_go = force_ || isInterrupted(output);
    if (!may_go) throw FileError(output, "exists; expected a new name, or --force to replace it");
  }
  const OutputFile can_be_made(output, force_);
  outputs_.push_back(output);
}

void OutputPlan::writeImage(const std::string& output, PictureKind kind) {
  if (!output.empty() && !canBeWritten(endingOf(output), kind)) {
    throw FileError(
        output, kind == PictureKind::colour
                    ? "does not have the ending of a picture that can be written in colour; "
                      "expected .png, .jpg, .tiff, .bmp or .ppm"
                    : "does not have the ending of a picture that can be written with transparent "
                      "parts; expected .png or .tiff");
  }
  write(output);
}

void OutputPlan::writeVideo(const std::string& output) {
  if (!output.empty() && endingOf(output) != ".mp4") {
    throw FileError(output, "does not have the ending of a video; expected .mp4");
  }
  write(output);
}

OutputFile::OutputFile(const std::string& path, bool force)
    : path_(path), force_(force), target_(resolved(path).string()) {
  for (int i = 0; i < kMostNames; ++i) {
    unfinished_ = unfinishedName(target_, i);
    lock_ = lockedFile(unfinished_);
    if (lock_ >= 0) return;
    if (errno != EEXIST) break;
  }
  unfinished_.clear();
  fail(path);
}

OutputFile::~OutputFile() {
  if (!unfinished_.empty()) unlink(unfinished_.c_str());
  if (lock_ >= 0) close(lock_);
}

/// Gives the file its final name, as a hard link. The temporary name stays until all files of the
/// run have their final names. Renames the file instead if it replaces another file or if linking
/// fails.
void OutputFile::place() {
  if (link(unfinished_.c_str(), target_.c_str()) == 0) {
    is_placed_ = true;
    return;
  }
  const std::string left = leftName(target_);
  const bool replaces = force_ || !left.empty();
  const bool done = replaces ? std::rename(unfinished_.c_str(), target_.c_str()) == 0
                             : renameToNew(unfinished_.c_str(), target_.c_str());
  if (!done && errno == EEXIST) {
    throw FileError(path_,
                    "was written by another program meanwhile; expected a new name, or --force");
  }
  if (!done) fail(path_);
  if (!left.empty()) unlink(left.c_str());
  unfinished_.clear();
  is_placed_ = !replaces;
}

void OutputFile::takeBack() noexcept {
  if (is_placed_) unlink(target_.c_str());
  is_placed_ = false;
}

void OutputFile::finish() {
  if (!unfinished_.empty()) unlink(unfinished_.c_str());
  unfinished_.clear();
  synchronised(fs::path(target_).parent_path().string(), O_RDONLY | O_DIRECTORY);
}

// Flushes the contents before the names are changed: otherwise, after a power cut, the disk might
// have the final name but not the contents.
void OutputFile::commit(const std::vector<OutputFile*>& files) {
  for (const OutputFile* file : files) {
    if (!synchronised(file->unfinished_, O_RDONLY)) fail(file->path_);
  }
  try {
    for (OutputFile* file : files) file->place();
  } catch (...) {
    for (OutputFile* file : files) file->takeBack();
    throw;
  }
  // Users take the last file as the sign that the run is complete, so remove its temporary name
  // first: if the program is killed before that, isInterrupted() returns true for this file.
  std::for_each(files.rbegin(), files.rend(), [](OutputFile* file) { file->finish(); });
}

OutputFile& Outputs::add(const std::string& path) {
  files_.push_back(std::make_unique<OutputFile>(path, force_));
  return *files_.back();
}

void Outputs::writeText(const std::string& path, const std::string& text) {
  if (isStandardOutput(path)) return files::writeText(path, text, force_);
  OutputFile& file = add(path);
  write(file, text);
  complete(file);
}

void Outputs::writeImage(const std::string& path, const cv::Mat& image) {
  OutputFile& file = add(path);
  files::writeImage(file, image);
  complete(file);
}

void Outputs::commit() {
  OutputFile::commit(complete_);
  complete_.clear();
}

bool isInterrupted(const std::string& path) {
  return !leftName(resolved(path).string()).empty();
}

bool isStandardOutput(const std::string& output) {
  return output == "-";
}

void throwUnwritable(const OutputFile& file, const std::string& otherwise) {
  constexpr std::size_t kTried = 1 << 20;  // bytes
  const std::vector<char> block(kTried);
  const int descriptor = open(file.unfinished().c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  std::size_t written = 0;
  while (descriptor >= 0 && written < kTried) {
    const ssize_t more = ::write(descriptor, block.data(), kTried - written);
    if (more <= 0) break;
    written += static_cast<std::size_t>(more);
  }
  const int error = errno;
  if (descriptor >= 0) close(descriptor);
  errno = error;
  if (written < kTried) fail(file.path());
  throw FileError(file.path(), "cannot be written: " + otherwise);
}

void writeText(const std::string& file, const std::string& text, bool force) {
  if (isStandardOutput(file)) {  // runProgram() checks stdout at exit
    std::fwrite(text.data(), 1, text.size(), stdout);
    return;
  }
  OutputFile out(file, force);
  write(out, text);
  out.commit();
}

void write(const OutputFile& file, const std::string& bytes) {
  std::ofstream out(file.unfinished(), std::ios::binary);
  out << bytes;
  out.close();
  if (!out || !synchronised(file.unfinished(), O_RDONLY)) fail(file.path());
}

void writeImage(const OutputFile& file, const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  bool encoded = false;
  try {
    encoded = cv::imencode(fs::path(file.path()).extension().string(), image, bytes);
  } catch (const cv::Exception& error) {
    throw FileError(file.path(), "cannot be written (" + error.err + ")");
  }
  if (!encoded) throw FileError(file.path(), "cannot be written");
  write(file, std::string(bytes.begin(), bytes.end()));
}

void writeImage(const std::string& file, const cv::Mat& image, bool force) {
  OutputFile out(file, force);
  writeImage(out, image);
  out.commit();
}

}  // namespace ktgp_orb::files
