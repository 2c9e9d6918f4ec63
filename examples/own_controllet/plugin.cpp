// What makes the library loadable: its controllets, by name, in one place.
#include "core/modes/plugin.hpp"

#include "virtual_wall.hpp"

MULTIPANDA_PLUGIN(registry) { registry.add(virtual_wall_controllet()); }
