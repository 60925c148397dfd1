// The bag reader with arbitrary bytes.
#include "bag/reader.h"
#include "input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace ktgp_orb;
  const fuzz::MemoryFile file(bytes, size);
  try {
    const auto source = openBag(file.path(), {});
    std::size_t images = 0;
    while (const auto image = source->next()) ++images;
    fuzz::require(images >= source->total() || !source->damage().empty(),
                  "no image is lost without a word");
    fuzz::require(images <= size, "no more images than bytes");
  } catch (const UnusableBag& error) {
    fuzz::require(error.what()[0] != '\0', "a refusal says why");
  }
  return 0;
}
