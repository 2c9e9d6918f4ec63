#include "core/modes/registry.hpp"

#include <algorithm>
#include <stdexcept>

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

}  // namespace multipanda
