// What makes the library loadable: its backend, by name.
#include "core/plugin/plugin.hpp"

#include "free_arms.hpp"

MULTIPANDA_PLUGIN(registry) {
  registry.add(multipanda::BackendType{
      .name = "free_arms",
      .doc = "Rigid arms without friction, delay or contact.",
      .create = [](const multipanda::BackendSetup& setup) { return std::make_unique<FreeArms>(setup); }});
}
