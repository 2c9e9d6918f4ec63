#include <algorithm>
#include <array>
#include <cmath>

#include "common/text.hpp"
#include "scene/load_parts.hpp"

namespace multipanda {
namespace {

const std::vector<std::string> kShapeNames{"plane", "box", "sphere", "cylinder", "capsule"};
// Which keys give the size of each shape, in the order of the enumeration.
const std::array<std::vector<std::string>, 5> kSizeKeys{
    {{}, {"size_m"}, {"diameter_m"}, {"diameter_m", "length_m"}, {"diameter_m", "length_m"}}};

}  // namespace

void visit_shape(Archive& archive, ShapeType& type, Vector3& size, const std::vector<std::string>& shapes,
                 double longest, const std::string& shape_doc) {
  std::string shape;
  archive(Key("shape", shape_doc).one_of(shapes).required(), shape);
  const bool has_length = std::find(shapes.begin(), shapes.end(), "capsule") != shapes.end();
  std::optional<Vector3> edges;
  std::optional<double> diameter, length;
  archive(Key("size_m", "Full edge lengths of a box along x, y, z.").within(kSmallest, longest), edges);
  archive(
      Key("diameter_m", has_length ? "Diameter of a sphere, cylinder or capsule." : "Diameter of a sphere.")
          .within(kSmallest, longest),
      diameter);
  if (has_length) {
    archive(Key("length_m", "Length of a cylinder, or of a capsule without its round ends.")
                .within(kSmallest, longest),
            length);
  }
  if (!archive.reading()) return;
  const auto index = std::find(kShapeNames.begin(), kShapeNames.end(), shape) - kShapeNames.begin();
  type = static_cast<ShapeType>(index);
  const auto& required = kSizeKeys[static_cast<std::size_t>(index)];
  for (const auto& key : archive.present({"size_m", "diameter_m", "length_m"})) {
    if (std::find(required.begin(), required.end(), key) == required.end()) {
      archive.at(key).refuse("a " + shape + " has no '" + key + "'; expected " +
                             (required.empty() ? "no size" : joined(required, " and ")));
    }
  }
  for (const auto& key : required) {
    if (!archive.has(key)) archive.self().refuse("a " + shape + " needs '" + key + "' [m]");
  }
  size = edges.value_or(Vector3(diameter.value_or(0), 0, length.value_or(0)));
}

void visit(Archive& archive, PlantFidelity& plant, Scene& scene) {
  archive.about(
      "Plant",
      "Simulation fidelity: a named set of values. Individual values may be changed. `ideal`: rigid bodies "
      "and perfect torques. `realistic`: joint friction of the robot model, torque tracking with a bandwidth "
      "of 50 Hz, a command delay of 1 ms, sensor noise. `realistic_sensors`: the same with sensors, "
      "estimates "
      "of forces and friction behind the sensors as measured on real arms. `fr3` has no friction values of "
      "its own and uses "
      "those of the Panda. The defaults below are those of `ideal`.");
  archive(Key("fidelity", "The named set.").one_of({"ideal", "realistic", "realistic_sensors"}), plant.name);
  if (plant.name == "realistic") plant = PlantFidelity::realistic();
  if (plant.name == "realistic_sensors") plant = PlantFidelity::realistic_sensors();
  archive(Key("substeps", "Physics steps per control period of 1 ms.").within(1, 100), scene.substeps);
  archive(Key("joint_friction", "Friction of the robot model."), plant.joint_friction);
  archive(Key("torque_bandwidth_hz", "Bandwidth of first-order torque tracking; 0: perfect tracking.")
              .within(0, 500),
          plant.torque_bandwidth_hz);
  archive(Key("command_delay_s", "Delay of commands, in whole control periods of 0.001 s.").within(0, 0.1),
          plant.command_delay_s);
  const auto noise = [&](const char* name, double& value, const std::string& of) {
    archive(Key(name, "Standard deviation of white noise on the measured " + of + ".").within(0, 10), value);
  };
  noise("noise_q_rad", plant.noise_q_rad, "joint positions");
  noise("noise_dq_rad_per_s", plant.noise_dq_rad_per_s, "joint velocities");
  noise("noise_tau_nm", plant.noise_tau_nm, "joint torques");
  archive(Key("stiction_nm", "Dry friction of every joint, unknown to the controllers.").within(0, 5),
          plant.stiction_nm);
  archive(Key("rotor_inertia_hidden",
              "How much of the rotors' inertia the arms' own torque loops hide. 1: the links move as if the "
              "motors had none; 0: all of it acts, as armature. Default: 1 in simulation, 0 of virtual arms. "
              "`motor_inertia_kg_m2` of a model replaces this.")
              .within(0, 1),
          plant.rotor_hidden);
  archive(Key("transmission_stiffness_nm_per_rad",
              "Every joint is elastic and measured at its motor: q = q_link + tau_J / stiffness; 0: rigid.")
              .within(0, 1e6),
          plant.transmission_stiffness_nm_per_rad);
  archive(Key("gear_ripple_nm",
              "Amplitude of torque ripple of every joint, 240 cycles per turn in joints 1 to 4, 160 in the "
              "others, as measured on a Panda.")
              .within(0, 2),
          plant.gear_ripple_nm);
  archive(Key("noslip_iterations",
              "Iterations of the contact solver that remove creep from friction: 5 for held objects.")
              .within(0, 100),
          scene.noslip_iterations);
  if (!archive.reading()) return;
  constexpr double kSoftest = 5000;
  if (const double k = plant.transmission_stiffness_nm_per_rad; k > 0 && k < kSoftest)
    archive.at("transmission_stiffness_nm_per_rad").expected("0 (rigid) or at least 5000 N m/rad");
  const double periods = plant.command_delay_s / kArmPeriod;
  if (std::abs(periods - std::round(periods)) > 1e-6)
    archive.at("command_delay_s").expected("whole control periods of 0.001 s");
  const auto changed =
      archive.present({"joint_friction", "torque_bandwidth_hz", "command_delay_s", "noise_q_rad",
                       "noise_dq_rad_per_s", "noise_tau_nm", "stiction_nm", "rotor_inertia_hidden",
                       "transmission_stiffness_nm_per_rad", "gear_ripple_nm"});
  if (!changed.empty()) plant.name += " (changed)";
}

void visit(Archive& archive, SurfaceContact& contact) {
  archive.about(
      "Contact",
      "Elastic contact between this object and every tool shape. A box that lies flat on a box or a "
      "plane touches at four corners, which share these values.");
  archive(Key("stiffness_n_per_m", "Normal force per penetration depth.").within(10, 1e6),
          contact.stiffness_n_per_m);
  archive(Key("damping_ratio", "Damping ratio of a body of 4 kg on that stiffness.").within(0, 2),
          contact.damping_ratio);
  archive(
      Key("tangential_damping_n_s_per_m",
          "Friction force per slip velocity, up to the friction limit. Large values make sliding chatter, "
          "small ones let held objects creep (`noslip_iterations` in `plant` prevents that).")
          .within(1, 2000),
      contact.tangential_damping_n_s_per_m);
}

void visit(Archive& archive, SceneObject& object, SceneReader& reader) {
  archive.about(
      "Object",
      "A body of the scene: fixed (a table, a wall) or free (it falls, can be pushed and grasped).");
  archive(Key("name", "Unique name.").identifier().required(), object.name);
  if (archive.reading()) {
    object.place = archive.self().place();
    for (const auto& other : reader.scene.objects) {
      if (other.name == object.name) {
        archive.at("name").refuse("two objects have this name, the first in line " +
                                  std::to_string(other.place.line));
      }
    }
  }
  visit_shape(
      archive, object.shape, object.size, kShapeNames, kFarthest,
      "A plane is infinite, its normal is the z axis of the object. A cylinder and a capsule lie along z.");
  visit_pose(archive, object.X_WO, Key("position_m", "Center of the object."));
  archive(Key("fixed", "`false`: a free body."), object.fixed);
  std::optional<double> mass;
  archive(Key("mass_kg", "Mass of a free body, required there.").within(kSmallest, 1000), mass);
  archive(Key("friction", "Coefficient of sliding friction.").within(0, 5), object.friction);
  archive(Key("contact_time_constant_s",
              "Time constant of contact forces; smaller is stiffer (MuJoCo's solref). Default: MuJoCo's.")
              .within(0.002, 1),
          object.contact_time_constant_s);
  archive(Key("contact_damping_ratio", "Damping ratio of the contact; 1: no bouncing. Default: MuJoCo's.")
              .within(0.01, 10),
          object.contact_damping_ratio);
  archive.section(Key("contact", "Contact with tool shapes in SI units. Default: as with other bodies."),
                  object.contact);
  archive(Key("color_rgba", "Red, green, blue, opacity.").within(0, 1), object.rgba);
  if (!archive.reading()) return;
  if (object.shape == ShapeType::plane && !object.fixed)
    archive.at("fixed").refuse("a plane is always fixed; remove 'fixed: false'");
  if (object.fixed && mass)
    archive.at("mass_kg").refuse("a fixed object has no mass; remove this line, or write 'fixed: false'");
  if (!object.fixed && !mass) archive.self().refuse("a free object needs 'mass_kg' [kg]");
  object.mass = mass.value_or(object.mass);
}

}  // namespace multipanda
