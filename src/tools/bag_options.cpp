#include "tools/bag_options.h"

#include <string>
#include <type_traits>

namespace ktgp_orb {
namespace {

/// Adds the option if the parameter is of type T.
template <typename T>
void addIf(CLI::App& app, const KtgpConfig::AbstractParamDescription& description,
           KtgpConfig& config) {
  const auto* typed = dynamic_cast<const KtgpConfig::ParamDescription<T>*>(&description);
  if (typed == nullptr) return;
  const auto field = typed->field;
  CLI::Option* option =
      app.add_option("--" + description.name, config.*field, description.description)
          ->capture_default_str()
          ->group("Parameters of the matcher");
  if constexpr (std::is_same_v<T, int> || std::is_same_v<T, double>) {
    option->check(CLI::Range(KtgpConfig::__getMin__().*field, KtgpConfig::__getMax__().*field));
  }
}

}  // namespace

void addParameterOptions(CLI::App& app, KtgpConfig& config) {
  for (const auto& description : KtgpConfig::__getParamDescriptions__()) {
    addIf<bool>(app, *description, config);
    addIf<int>(app, *description, config);
    addIf<double>(app, *description, config);
    addIf<std::string>(app, *description, config);
  }
}

}  // namespace ktgp_orb
