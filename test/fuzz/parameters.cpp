// The parameter table from texts and files: the core accepts everything that the table accepts.
#include <stdexcept>

#include "input.h"
#include "parameters/options.h"
#include "tools/parameter_file.h"

namespace ktgp_orb::fuzz {
namespace {

void requireTaken(const Parameters& parameters) {
  requireValid(parameters);
  const SequenceOptions options = sequenceOptions(parameters);
  static_cast<void>(options);
  Parameters copy;
  for (const ParameterRow& row : parameterRows()) {
    const std::string text = valueText(row, parameters);
    setParameter(row, text, copy);
    require(valueText(row, copy) == text, "a value is its text");
  }
}

void runTexts(Input& in) {
  Parameters parameters;
  while (in.remaining_bytes() > 0) {
    const ParameterRow& row =
        parameterRows()[in.ConsumeIntegralInRange<std::size_t>(0, parameterRows().size() - 1)];
    const std::string text = in.ConsumeRandomLengthString(40);
    try {
      setParameter(row, text, parameters);
    } catch (const std::invalid_argument& error) {
      require(std::string(error.what()).find(row.name) != std::string::npos,
              "an error names the parameter");
    }
  }
  requireTaken(parameters);
}

void runFile(Input& in) {
  const std::string text = in.ConsumeRemainingBytesAsString();
  const MemoryFile file(text.data(), text.size());
  Parameters parameters;
  try {
    tools::readParameterFile(file.path(), parameters);
  } catch (const std::invalid_argument&) {
    return;
  }
  requireTaken(parameters);
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  if (in.ConsumeBool()) {
    ktgp_orb::fuzz::runTexts(in);
  } else {
    ktgp_orb::fuzz::runFile(in);
  }
  return 0;
}
