// For the test only: a library that was built with other headers, with other flags, or with the headers of a
// version that did not export their hash.
#include <multipanda_headers_hash.hpp>

#include "core/plugin/layout.hpp"

extern "C" {
#ifdef HEADERS
const char* multipanda_plugin_headers();
std::uint64_t multipanda_plugin_layout();
__attribute__((visibility("default"))) const char* multipanda_plugin_headers() { return HEADERS; }
__attribute__((visibility("default"))) std::uint64_t multipanda_plugin_layout() {
  using multipanda::kPluginLayout;
  return LAYOUT;
}
#else
unsigned multipanda_plugin_version();
__attribute__((visibility("default"))) unsigned multipanda_plugin_version() { return 3016; }
#endif
void multipanda_plugin_register(multipanda::Registry& registry);
__attribute__((visibility("default"))) void multipanda_plugin_register(multipanda::Registry&) {}
}
