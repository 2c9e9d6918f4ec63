// Registers the controllets and features of the library.
#include "core/plugin/plugin.hpp"

#include "speed_damping.hpp"
#include "virtual_wall.hpp"

MULTIPANDA_PLUGIN(registry) {
  registry.add(virtual_wall_controllet());
  registry.add(speed_damping_feature());
}
