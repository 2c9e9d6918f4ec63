#include "ros/adapter/controllets/controllets.hpp"

#include "ros/adapter/controllets/inputs.hpp"
#include "ros/adapter/controllets/mode_services.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "ros/adapter/controllets/shown_values.hpp"

namespace multipanda::ros {

Parts make_controllets(const AdapterWorld& world) {
  const auto codecs = codecs_of(world.scene->plugins);
  Parts parts;
  parts.push_back(std::make_unique<ModeServices>(world, codecs));
  parts.push_back(std::make_unique<Inputs>(world, codecs));
  parts.push_back(std::make_unique<ShownValues>(world, codecs));
  if (world.options->parameter_services) parts.push_back(std::make_unique<ParameterServices>(world));
  return parts;
}

}  // namespace multipanda::ros
