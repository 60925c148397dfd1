#include "ktgp_orb/status.h"

#include "core/util/names.h"

namespace ktgp_orb {

const char* toString(Status status) {
  return util::nameOf<Status::model_rejected>(
      status,
      {"ok", "no_reference", "too_few_features", "too_few_matches", "no_model", "model_rejected"});
}

}  // namespace ktgp_orb
