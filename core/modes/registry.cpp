#include "core/modes/registry.hpp"

#include <algorithm>
#include <dlfcn.h>
#include <stdexcept>

#include "core/modes/plugin.hpp"

namespace multipanda {
namespace {

template <typename Types>
auto* find_type(Types& types, std::string_view name) {
  const auto it =
      std::find_if(types.begin(), types.end(), [&](const auto& t) { return t.descriptor.type == name; });
  return it == types.end() ? nullptr : &*it;
}

template <typename Types, typename Type>
void add_type(Types& types, Type type, const char* what) {
  if (find_type(types, type.descriptor.type) != nullptr) {
    throw std::invalid_argument(std::string(what) + " '" + type.descriptor.type + "' is registered twice");
  }
  if (type.create == nullptr) throw std::invalid_argument(std::string(what) + " without a factory");
  types.push_back(std::move(type));
}

}  // namespace

void Registry::add(ControlletType type) { add_type(controllets_, std::move(type), "controllet"); }
void Registry::add(FeatureType type) { add_type(features_, std::move(type), "feature"); }
void Registry::add(BackendType type) {
  if (backend(type.name) != nullptr)
    throw std::invalid_argument("backend '" + type.name + "' is registered twice");
  if (!type.create) throw std::invalid_argument("backend '" + type.name + "' has no factory");
  backends_.push_back(std::move(type));
}

const ControlletType* Registry::controllet(std::string_view type) const {
  return find_type(controllets_, type);
}
const FeatureType* Registry::feature(std::string_view type) const { return find_type(features_, type); }

const BackendType* Registry::backend(std::string_view name) const {
  const auto it = std::ranges::find(backends_, name, &BackendType::name);
  return it == backends_.end() ? nullptr : &*it;
}

void Registry::load_plugin(const std::string& path) {
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) throw std::runtime_error("library " + path + ": " + dlerror());
  const auto version = reinterpret_cast<unsigned (*)()>(dlsym(library, "multipanda_plugin_version"));
  const auto add_all = reinterpret_cast<void (*)(Registry&)>(dlsym(library, "multipanda_plugin_register"));
  std::string reason;
  if (version == nullptr || add_all == nullptr) {
    reason =
        "it exports no controllets, features or backends; it needs MULTIPANDA_PLUGIN(registry) {...} "
        "(core/modes/plugin.hpp)";
  } else if (version() != kPluginVersion) {
    reason = "it was built for interface " + std::to_string(version()) + ", this program has " +
             std::to_string(kPluginVersion) +
             "; rebuild it against these headers, without vector flags such as -march=native";
  }
  if (!reason.empty()) {
    dlclose(library);
    throw std::runtime_error("library " + path + ": " + reason);
  }
  add_all(*this);
}

}  // namespace multipanda
