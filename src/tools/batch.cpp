#include "tools/batch.h"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <map>
#include <optional>
#include <stdexcept>
#include <vector>

#include "cli/files.h"
#include "cli/output_file.h"
#include "cli/program.h"
#include "tools/batch_list.h"
#include "tools/batch_worker.h"
#include "tools/manifest.h"

namespace ktgp_orb {
namespace {

std::string quoted(std::string text) {
  for (std::size_t i = 0; (i = text.find('"', i)) != std::string::npos; i += 2)
    text.insert(i, 1, '"');
  return '"' + text + '"';
}

const char* statusOf(const std::optional<Outcome>& outcome) {
  if (!outcome) return "missing";
  if (outcome->exit_code == tools::kExitDone) return "done";
  return outcome->exit_code == tools::kExitUnusedData ? "incomplete" : "failed";
}

class Batch {
 public:
  Batch(const BatchOptions& options, const ProcessRecording& process)
      : options_(options), process_(process), recordings_(readBatchList(options.list)) {
    for (std::size_t i = options.part - 1; i < recordings_.size(); i += options.parts) {
      wanted_.push_back(i);
    }
    outcomes_.resize(recordings_.size());
    std::filesystem::create_directories(options.folder);
  }

  int run() {
    for (const std::size_t i : wanted_) {
      if (stopped()) break;
      startUnlessFinished(i);
      while (static_cast<int>(workers_.size()) >= options_.jobs && !workers_.empty()) waitForOne();
    }
    if (tools::interrupted()) {
      for (const auto& worker : workers_) kill(worker.first, SIGTERM);
    }
    while (!workers_.empty()) waitForOne();
    removeEmptyFolders();
    if (options_.parts == 1) writeSummary();
    return report();
  }

 private:
  bool stopped() const { return tools::interrupted() || !full_disk_.empty(); }

  void startUnlessFinished(std::size_t i) {
    const ListedRecording& recording = recordings_[i];
    if (!recording.problem.empty()) {
      finish(i, {tools::kExitUnusable, 0, 0, 0, 0, recording.problem});
      return;
    }
    Origin origin{sizeOfInput(recording.input), options_.parameters, tools::version()};
    outcomes_[i] = finishedOutcome(options_.folder + "/" + recording.name, origin);
    if (outcomes_[i]) {
      ++found_finished_;
      finish(i, *outcomes_[i]);
      return;
    }
    const BatchWorker worker(options_.folder, recording.name, recording.input, origin, process_);
    workers_[worker.pid()] = {worker, i, origin};
  }

  /// Ctrl-C reaches the workers as well, but a signal for this process alone does not.
  void waitForOne() {
    constexpr timespec kPause{0, 10'000'000};
    int status = 0;
    pid_t pid = 0;
    bool told = false;
    while ((pid = waitpid(-1, &status, WNOHANG)) == 0) {
      if (tools::interrupted() && !std::exchange(told, true)) {
        for (const auto& worker : workers_) kill(worker.first, SIGTERM);
      }
      nanosleep(&kPause, nullptr);
    }
    const auto ended = workers_.find(pid);
    if (ended == workers_.end()) throw std::runtime_error("a worker was lost");
    const Running running = ended->second;
    workers_.erase(ended);
    const Outcome failure = running.worker.failure(status);
    const std::string& name = recordings_[running.recording].name;
    const auto outcome = finishedOutcome(options_.folder + "/" + name, running.origin);
    if (outcome) {
      finish(running.recording, *outcome);
    } else if (failure.exit_code == kExitFullDisk) {
      if (full_disk_.empty()) full_disk_ = failure.reason;
    } else if (failure.exit_code != tools::kExitInterrupted) {
      finish(running.recording, failure);
    }
  }

  void finish(std::size_t i, const Outcome& outcome) {
    outcomes_[i] = outcome;
    if (outcome.exit_code == tools::kExitDone) return;
    std::fprintf(stderr, "ktgp_bag: row %zu: %s: exit code %d: %s\n", recordings_[i].row,
                 recordings_[i].input.c_str(), outcome.exit_code, outcome.reason.c_str());
  }

  void removeEmptyFolders() const {
    namespace fs = std::filesystem;
    std::error_code ignored;
    const fs::path all = fs::path(options_.folder) / ".unfinished";
    for (const std::size_t i : wanted_) {
      fs::path folder = (all / recordings_[i].name).parent_path();
      while (folder != all.parent_path() && fs::remove(folder, ignored)) {
        folder = folder.parent_path();
      }
    }
  }

  void writeSummary() const {
    std::string text = "recording,output,status,exit_code,images,refused,skipped,found,reason\n";
    for (std::size_t i = 0; i < recordings_.size(); ++i) {
      const Outcome outcome = outcomes_[i].value_or(Outcome{});
      text += quoted(recordings_[i].input) + ',' + quoted(recordings_[i].name) + ',' +
              statusOf(outcomes_[i]) + ',' +
              (outcomes_[i] ? std::to_string(outcome.exit_code) : "") + ',' +
              std::to_string(outcome.images) + ',' + std::to_string(outcome.refused) + ',' +
              std::to_string(outcome.skipped) + ',' + std::to_string(outcome.found) + ',' +
              quoted(outcome.reason) + '\n';
    }
    try {
      tools::writeText(options_.folder + "/summary.csv", text, true);
    } catch (const tools::FullDisk& error) {
      if (full_disk_.empty()) throw;
      std::fprintf(stderr, "ktgp_bag: %s\n", error.what());
    }
  }

  int report() const {
    std::map<std::string, std::size_t> counts;
    const ListedRecording* first_missing = nullptr;
    for (const std::size_t i : wanted_) {
      ++counts[statusOf(outcomes_[i])];
      if (!outcomes_[i] && first_missing == nullptr) first_missing = &recordings_[i];
    }
    std::fprintf(stderr,
                 "%zu recordings: %zu done, %zu incomplete, %zu failed, %zu missing; %zu were "
                 "finished before; results in %s\n",
                 wanted_.size(), counts["done"], counts["incomplete"], counts["failed"],
                 counts["missing"], found_finished_, options_.folder.c_str());
    if (!full_disk_.empty()) {
      std::fprintf(
          stderr, "ktgp_bag: stopped: %s; %zu recordings are missing, the first is row %zu, %s\n",
          full_disk_.c_str(), counts["missing"], first_missing->row, first_missing->input.c_str());
      return tools::kExitUnusable;
    }
    if (tools::interrupted()) return tools::kExitInterrupted;
    return counts["done"] == wanted_.size() ? tools::kExitDone : tools::kExitUnusedData;
  }

  struct Running {
    BatchWorker worker;
    std::size_t recording = 0;
    Origin origin;
  };

  BatchOptions options_;
  ProcessRecording process_;
  std::vector<ListedRecording> recordings_;
  std::vector<std::size_t> wanted_;  // of this part
  std::vector<std::optional<Outcome>> outcomes_;
  std::map<pid_t, Running> workers_;
  std::size_t found_finished_ = 0;
  std::string full_disk_;  // the first worker's reason; empty while there is space
};

}  // namespace

void setPart(const std::string& text, BatchOptions& options) {
  std::size_t part = 0;
  std::size_t parts = 0;
  char rest = 0;
  const bool read = std::sscanf(text.c_str(), "%zu/%zu%c", &part, &parts, &rest) == 2;
  if (!read || part < 1 || part > parts || text[0] == '-') {
    throw std::invalid_argument("--part is " + text + "; expected K/N with K from 1 to N");
  }
  options.part = part;
  options.parts = parts;
}

int runBatch(const BatchOptions& options, const ProcessRecording& process) {
  return Batch(options, process).run();
}

}  // namespace ktgp_orb
