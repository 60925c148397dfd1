#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace ktgp_orb {

/// A row of the list of recordings.
struct ListedRecording {
  std::size_t row = 0;  ///< line in the file, from 1
  std::string input;
  std::string name;       ///< of its folder below the output folder; from the input's name alone
  std::string problem{};  ///< why the row is not used; empty if it is
};

/// The recordings of a text file, one per line; empty lines and lines that begin with # do not
/// count. Of several rows with one name the first is used. Throws FileError for a file that cannot
/// be read or names no recording.
std::vector<ListedRecording> readBatchList(const std::string& file);

/// The path of the input without "/" at its beginning; with the working directory where it leads
/// out of it. The pattern of images has _ for each * ? [ and ].
std::string batchNameOf(const std::string& input);

}  // namespace ktgp_orb
