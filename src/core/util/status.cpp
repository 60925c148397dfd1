#include "ktgp_orb/status.h"

namespace ktgp_orb {

const char* toString(Status status) {
  switch (status) {
    case Status::ok:
      return "ok";
    case Status::no_reference:
      return "no_reference";
    case Status::too_few_features:
      return "too_few_features";
    case Status::too_few_matches:
      return "too_few_matches";
    case Status::no_model:
      return "no_model";
    case Status::model_rejected:
      return "model_rejected";
  }
  return "unknown";
}

}  // namespace ktgp_orb
