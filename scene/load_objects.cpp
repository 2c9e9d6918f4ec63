#include <array>
#include <cmath>
#include <tuple>

#include "scene/load_parts.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

using Kind = ShapeType;

// Which keys give the size of each shape, in the order of the enumeration.
const std::array<std::vector<std::string>, 5> kSizeKeys{
    {{}, {"size_m"}, {"diameter_m"}, {"diameter_m", "length_m"}, {"diameter_m", "length_m"}}};

Vector3 read_size(const Mapping& mapping, ShapeType type, const std::string& shape,
                  const std::vector<std::string>& size_keys) {
  const auto& wanted = kSizeKeys[static_cast<std::size_t>(type)];
  for (const auto& key : mapping.present(size_keys)) {
    if (std::find(wanted.begin(), wanted.end(), key) == wanted.end()) {
      mapping.entry(key).refuse("a " + shape + " has no '" + key + "'; expected " +
                                (wanted.empty() ? "no size" : joined(wanted, " and ")));
    }
  }
  for (const auto& key : wanted) {
    if (!mapping.has(key)) mapping.self().refuse("a " + shape + " needs '" + key + "' [m]");
  }
  Vector3 size = Vector3::Zero();
  if (type == Kind::box) size = mapping.vector3("size_m");
  if (type != Kind::box && type != Kind::plane) size.x() = mapping.number("diameter_m");
  if (type == Kind::cylinder || type == Kind::capsule) size.z() = mapping.number("length_m");
  return size;
}

SurfaceContact read_contact(const Mapping& mapping) {
  return {.stiffness_n_per_m = mapping.number("stiffness_n_per_m"),
          .damping_ratio = mapping.number("damping_ratio"),
          .tangential_damping_n_s_per_m = mapping.number("tangential_damping_n_s_per_m")};
}

}  // namespace

std::pair<ShapeType, Vector3> read_shape(const Mapping& mapping, const std::vector<std::string>& size_keys) {
  const std::string shape = mapping.text("shape");
  const std::array names{"plane", "box", "sphere", "cylinder", "capsule"};
  const auto type = static_cast<ShapeType>(std::find(names.begin(), names.end(), shape) - names.begin());
  return {type, read_size(mapping, type, shape, size_keys)};
}

void read_plant(const Mapping& root, SceneReader& reader) {
  const Mapping mapping = root.section("plant");
  PlantFidelity plant =
      mapping.text("fidelity") == "realistic" ? PlantFidelity::realistic() : PlantFidelity::ideal();
  const std::pair<const char*, double*> numbers[] = {{"torque_bandwidth_hz", &plant.torque_bandwidth_hz},
                                                     {"command_delay_s", &plant.command_delay_s},
                                                     {"noise_q_rad", &plant.noise_q_rad},
                                                     {"noise_dq_rad_per_s", &plant.noise_dq_rad_per_s},
                                                     {"noise_tau_nm", &plant.noise_tau_nm},
                                                     {"stiction_nm", &plant.stiction_nm}};
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
  reader.scene.noslip_iterations = static_cast<std::size_t>(mapping.number("noslip_iterations"));
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
    std::tie(object.shape, object.size) = read_shape(mapping, {"size_m", "diameter_m", "length_m"});
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
    if (mapping.has("contact")) object.contact = read_contact(mapping.section("contact"));
    const auto rgba = mapping.numbers("color_rgba");
    std::copy(rgba.begin(), rgba.end(), object.rgba.begin());
    reader.scene.objects.push_back(std::move(object));
  }
}

}  // namespace multipanda
