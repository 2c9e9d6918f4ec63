// For the test only: a library that reports another interface version.
#include "core/modes/registry.hpp"

extern "C" unsigned multipanda_plugin_version();
extern "C" void multipanda_plugin_register(multipanda::Registry& registry);

extern "C" __attribute__((visibility("default"))) unsigned multipanda_plugin_version() { return 999016; }
extern "C" __attribute__((visibility("default"))) void multipanda_plugin_register(multipanda::Registry&) {}
