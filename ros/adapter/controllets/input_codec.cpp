#include "ros/adapter/controllets/input_codec.hpp"

#include <dlfcn.h>
#include <stdexcept>

namespace multipanda::ros {

std::vector<InputCodec> codecs_of(const std::vector<std::string>& plugins) {
  std::vector<InputCodec> codecs;
  for (const auto& path : plugins) {
    // The registry has loaded the library already and never unloads it.
    void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
      const char* why = dlerror();
      throw std::runtime_error("plugin '" + path + "': " + (why != nullptr ? why : "cannot be loaded"));
    }
    const auto version = reinterpret_cast<unsigned (*)()>(dlsym(library, "multipanda_input_codecs_version"));
    const auto fill =
        reinterpret_cast<void (*)(std::vector<InputCodec>&)>(dlsym(library, "multipanda_input_codecs"));
    if (version == nullptr || fill == nullptr) continue;
    if (version() != kCodecVersion) {
      throw std::runtime_error("plugin '" + path + "' has input codecs of version " +
                               std::to_string(version()) + ", this program expects " +
                               std::to_string(kCodecVersion) + ": rebuild it against these headers");
    }
    fill(codecs);
  }
  return codecs;
}

}  // namespace multipanda::ros
