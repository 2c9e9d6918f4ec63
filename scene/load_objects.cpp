#include <array>
#include <cmath>

#include "scene/load_parts.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

using Kind = SceneObject::Shape;

// Which keys give the size of each shape; in the order of the choices of the table and of the enumeration.
const std::array<std::vector<std::string>, 5> kSizeKeys{
    {{}, {"size_m"}, {"diameter_m"}, {"diameter_m", "length_m"}, {"diameter_m", "length_m"}}};

void read_size(const Mapping& mapping, const std::string& shape, SceneObject& object) {
  const auto& wanted = kSizeKeys[static_cast<std::size_t>(object.shape)];
  for (const auto& key : mapping.present({"size_m", "diameter_m", "length_m"})) {
    if (std::find(wanted.begin(), wanted.end(), key) == wanted.end()) {
      mapping.entry(key).refuse("a " + shape + " has no '" + key + "'; expected " +
                                (wanted.empty() ? "no size" : joined(wanted, " and ")));
    }
  }
  for (const auto& key : wanted) {
    if (!mapping.has(key)) mapping.self().refuse("a " + shape + " needs '" + key + "' [m]");
  }
  object.size = Vector3::Zero();
  if (object.shape == Kind::box) object.size = mapping.vector3("size_m");
  if (mapping.has("diameter_m")) object.size.x() = mapping.number("diameter_m");
  if (mapping.has("length_m")) object.size.z() = mapping.number("length_m");
}

}  // namespace

void read_plant(const Mapping& root, SceneReader& reader) {
  const Mapping mapping = root.section("plant");
  PlantFidelity plant =
      mapping.text("fidelity") == "realistic" ? PlantFidelity::realistic() : PlantFidelity::ideal();
  const std::pair<const char*, double*> numbers[] = {{"torque_bandwidth_hz", &plant.torque_bandwidth_hz},
                                                     {"command_delay_s", &plant.command_delay_s},
                                                     {"noise_q_rad", &plant.noise_q_rad},
                                                     {"noise_dq_rad_per_s", &plant.noise_dq_rad_per_s},
                                                     {"noise_tau_nm", &plant.noise_tau_nm}};
  bool changed = mapping.has("joint_friction");
  if (changed) plant.joint_friction = mapping.boolean("joint_friction");
  for (const auto& [key, value] : numbers) {
    if (!mapping.has(key)) continue;
    *value = mapping.number(key);
    changed = true;
  }
  constexpr double kPeriod = 0.001;
  const double periods = plant.command_delay_s / kPeriod;
  if (std::abs(periods - std::round(periods)) > 1e-6) {
    mapping.entry("command_delay_s").expected("whole control periods of 0.001 s");
  }
  if (changed) plant.name += " (changed)";  // reports must not call it what it no longer is
  reader.scene.plant = plant;
  reader.scene.substeps = static_cast<std::size_t>(mapping.number("substeps"));
}

void read_objects(const Mapping& root, SceneReader& reader) {
  std::size_t number = 0;
  for (const auto& item : root.items("objects")) {
    Mapping mapping(item.as("object " + std::to_string(++number)), schema::object());
    SceneObject object;
    object.name = mapping.text("name");
    object.place = mapping.self().place();
    for (const auto& other : reader.scene.objects) {
      if (other.name == object.name) {
        mapping.entry("name").refuse("two objects are called " + in_quotes(object.name) +
                                     ", the first in line " + std::to_string(other.place.line));
      }
    }
    mapping.rename("object '" + object.name + "'");
    const std::string shape = mapping.text("shape");
    const auto& shapes = mapping.field("shape").choices;
    object.shape = static_cast<Kind>(std::find(shapes.begin(), shapes.end(), shape) - shapes.begin());
    read_size(mapping, shape, object);
    object.X_WO = read_pose(mapping);
    object.fixed = mapping.boolean("fixed");
    if (object.shape == Kind::plane && !object.fixed)
      mapping.entry("fixed").refuse("a plane is always fixed");
    if (object.fixed && mapping.has("mass_kg")) {
      mapping.entry("mass_kg").refuse("a fixed object has no mass; leave it out, or write 'fixed: false'");
    }
    if (!object.fixed && !mapping.has("mass_kg")) mapping.self().refuse("a free object needs 'mass_kg' [kg]");
    if (mapping.has("mass_kg")) object.mass = mapping.number("mass_kg");
    object.friction = mapping.number("friction");
    if (mapping.has("contact_time_constant_s")) {
      object.contact_time_constant_s = mapping.number("contact_time_constant_s");
    }
    if (mapping.has("contact_damping_ratio"))
      object.contact_damping_ratio = mapping.number("contact_damping_ratio");
    const auto rgba = mapping.numbers("color_rgba");
    std::copy(rgba.begin(), rgba.end(), object.rgba.begin());
    reader.scene.objects.push_back(std::move(object));
  }
}

}  // namespace multipanda
