#include "core/plugin/load_plugin.hpp"

#include <cstdio>
#include <dlfcn.h>
#include <multipanda_headers_hash.hpp>
#include <stdexcept>

#include "core/plugin/layout.hpp"

namespace multipanda {
namespace {

template <typename Function>
Function symbol(void* library, const char* name) {
  return reinterpret_cast<Function>(dlsym(library, name));
}

std::string hexadecimal(std::uint64_t number) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(number));
  return text;
}

// Why this program cannot use the library, or an empty string. Calls nothing of the library that depends on
// shared types.
std::string refusal(void* library) {
  if (symbol<void*>(library, "multipanda_plugin_register") == nullptr) {
    return "it exports no controllets, features or backends; it needs MULTIPANDA_PLUGIN(registry) {...} "
           "(core/plugin/plugin.hpp), or multipanda_laws (core/plugin/c_law.h)";
  }
  const auto headers = symbol<const char* (*)()>(library, "multipanda_plugin_headers");
  const auto layout = symbol<std::uint64_t (*)()>(library, "multipanda_plugin_layout");
  if (headers == nullptr || layout == nullptr) {
    return "it was built with the headers of an older version, which have no hash; rebuild it with "
           "the "
           "headers of this program";
  }
  if (std::string_view(headers()) != MULTIPANDA_HEADERS_HASH) {
    return std::string("it was built with other headers (hash ") + headers() + ") than this program (hash " +
           MULTIPANDA_HEADERS_HASH + "); rebuild it with the headers of this program";
  }
  if (layout() != kPluginLayout) {
    return "it was built with the headers of this program, but its types have another layout (" +
           hexadecimal(layout()) + ") than this program's (" + hexadecimal(kPluginLayout) +
           "); rebuild it with the same compiler and Eigen, without flags such as -march=native or "
           "-D_GLIBCXX_DEBUG";
  }
  return {};
}

using CLaws = const multipanda_c_laws* (*)();

// All or none: a name already in use leaves the registry unchanged.
void add_laws(Registry& registry, CLaws exported) {
  const multipanda_c_laws* laws = exported();
  if (laws == nullptr) throw std::runtime_error("its function multipanda_laws returns nothing");
  std::vector<ControlletType> types = c_law_controllets(*laws);
  Registry with_laws = registry;
  for (auto& type : types) with_laws.add(std::move(type));
  registry = std::move(with_laws);
}

}  // namespace

void load_plugin(Registry& registry, const std::string& path) {
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) throw std::runtime_error("library " + path + ": " + dlerror());
  // Laws behind the C interface share no C++ types: version and sizes decide whether they match.
  if (const auto laws = symbol<CLaws>(library, "multipanda_laws"); laws != nullptr) {
    try {
      return add_laws(registry, laws);
    } catch (const std::runtime_error& error) {
      dlclose(library);
      throw std::runtime_error("library " + path + ": " + error.what());
    } catch (...) {
      dlclose(library);
      throw;
    }
  }
  if (const std::string reason = refusal(library); !reason.empty()) {
    dlclose(library);
    throw std::runtime_error("library " + path + ": " + reason);
  }
  symbol<void (*)(Registry&)>(library, "multipanda_plugin_register")(registry);
}

}  // namespace multipanda
