#include "files/jpeg_data.h"

#include <algorithm>
#include <csetjmp>
#include <cstdint>
#include <cstdio>  // jpeglib.h needs FILE

// Include jpeglib.h first: jerror.h uses its macros.
#include <jpeglib.h>

#include <jerror.h>

namespace ktgp_orb::files {
namespace {

/// Returns true if a corner of the picture has exactly the grey with which decoders fill missing
/// data.
bool hasGreyCorner(const cv::Mat& picture) {
  constexpr std::uint8_t kFilled = 128;
  if (picture.empty() || picture.depth() != CV_8U) return false;
  for (const int row : {0, picture.rows - 1}) {
    for (const int column : {0, picture.cols - 1}) {
      const auto* const pixel = picture.ptr<std::uint8_t>(row, column);
      const auto* const end = pixel + picture.channels();
      if (std::all_of(pixel, end, [](std::uint8_t value) { return value == kFilled; })) return true;
    }
  }
  return false;
}

/// libjpeg's error handler with our own fields. `base` must be the first member: libjpeg only has a
/// pointer to it, and errorsOf() casts this pointer back to Errors.
struct Errors {
  jpeg_error_mgr base{};
  std::jmp_buf end{};
  bool lacks_data = false;
};

Errors& errorsOf(j_common_ptr jpeg) {
  return *reinterpret_cast<Errors*>(jpeg->err);
}

/// Called by libjpeg for messages. Remembers only the warnings that mean missing pixels; others are
/// harmless, such as extra bytes between the markers.
void emitMessage(j_common_ptr jpeg, int level) {
  constexpr int kWarning = -1;
  if (level != kWarning) return;
  for (const int missing : {JWRN_HIT_MARKER, JWRN_JPEG_EOF, JWRN_HUFF_BAD_CODE, JWRN_MUST_RESYNC}) {
    if (jpeg->err->msg_code == missing) errorsOf(jpeg).lacks_data = true;
  }
}

/// Called by libjpeg for errors. libjpeg requires that this function does not return.
[[noreturn]] void exitOnError(j_common_ptr jpeg) {
  std::longjmp(errorsOf(jpeg).end, 1);
}

/// Decodes the picture at an eighth of its size, to make libjpeg read all compressed data. At this
/// size, computing the pixels costs little.
void decode(jpeg_decompress_struct& jpeg) {
  jpeg.scale_num = 1;
  jpeg.scale_denom = 8;
  jpeg_start_decompress(&jpeg);
  const JDIMENSION width = jpeg.output_width * static_cast<JDIMENSION>(jpeg.output_components);
  const JSAMPARRAY row =
      jpeg.mem->alloc_sarray(reinterpret_cast<j_common_ptr>(&jpeg), JPOOL_IMAGE, width, 1);
  while (jpeg.output_scanline < jpeg.output_height) jpeg_read_scanlines(&jpeg, row, 1);
  jpeg_finish_decompress(&jpeg);
}

}  // namespace

bool lacksData(std::string_view bytes, const cv::Mat& picture) {
  if (bytes.substr(0, 3) != "\xFF\xD8\xFF") return false;
  jpeg_decompress_struct jpeg{};
  Errors errors;
  jpeg.err = jpeg_std_error(&errors.base);
  errors.base.emit_message = emitMessage;
  errors.base.error_exit = exitOnError;
  // If libjpeg reports an error, longjmp() in exitOnError() returns to this setjmp(). It skips
  // destructors, but no object between the two has one. We ignore the error: OpenCV could decode
  // the picture, so libjpeg just does not support this kind of JPEG.
  if (setjmp(errors.end) == 0) {
    jpeg_create_decompress(&jpeg);
    jpeg_mem_src(&jpeg, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
    jpeg_read_header(&jpeg, TRUE);
    // A progressive JPEG without its last scans is blurred instead of grey, so always decode it.
    if (jpeg.progressive_mode || hasGreyCorner(picture)) decode(jpeg);
  }
  jpeg_destroy_decompress(&jpeg);
  return errors.lacks_data;
}

}  // namespace ktgp_orb::files
