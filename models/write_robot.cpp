#include "models/write_robot.hpp"

#include <fstream>
#include <stdexcept>
#include <unistd.h>

#include "models/xml_text.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

bool same(const FrictionLaw& a, const FrictionLaw& b);
bool same(const TorqueSensor& a, const TorqueSensor& b);
bool same(const Actuation& a, const Actuation& b);
bool same(const IdentifiedRange& a, const IdentifiedRange& b);
bool same(const HandDescription& a, const HandDescription& b);

bool same(const JointVector& a, const JointVector& b) { return a.size() == b.size() && a == b; }

bool same(const Placement& a, const Placement& b) { return a.position == b.position && a.rpy == b.rpy; }

bool same(const RigidBody& a, const RigidBody& b) {
  return a.mass == b.mass && a.com == b.com && a.inertia == b.inertia;
}

bool same(const JointFriction& a, const JointFriction& b) {
  return same(a.p1, b.p1) && same(a.p2, b.p2) && same(a.p3, b.p3);
}

bool same(const PreslidingElement& a, const PreslidingElement& b) {
  return a.distance == b.distance && same(a.amplitude, b.amplitude);
}

template <class T>
bool same(const std::vector<T>& a, const std::vector<T>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const T& x, const T& y) { return same(x, y); });
}

template <class T>
bool same(const std::optional<T>& a, const std::optional<T>& b) {
  return a.has_value() == b.has_value() && (!a || same(*a, *b));
}

bool same(const FrictionLaw& a, const FrictionLaw& b) {
  return same(a.offset, b.offset) && same(a.viscous, b.viscous) && same(a.stribeck, b.stribeck) &&
         same(a.presliding, b.presliding) && same(a.sigmoid, b.sigmoid);
}

bool same(const TorqueSensor& a, const TorqueSensor& b) {
  return same(a.gain, b.gain) && same(a.offset, b.offset) && a.noise == b.noise;
}

bool same(const IdentifiedRange& a, const IdentifiedRange& b) {
  return same(a.q_min, b.q_min) && same(a.q_max, b.q_max) && same(a.dq_max, b.dq_max) && same(a.rmse, b.rmse);
}

bool same(const Actuation& a, const Actuation& b) {
  return a.torque_bandwidth_hz == b.torque_bandwidth_hz && a.command_delay == b.command_delay;
}

bool same(const HandDescription& a, const HandDescription& b) {
  return same(a.mount, b.mount) && same(a.tcp, b.tcp) && same(a.finger_mount, b.finger_mount) &&
         same(a.body, b.body) && same(a.finger, b.finger);
}

bool same(const JointLimits& a, const JointLimits& b) {
  return same(a.q_min, b.q_min) && same(a.q_max, b.q_max) && same(a.dq_max, b.dq_max) &&
         same(a.tau_max, b.tau_max) && same(a.ddq_max, b.ddq_max) && same(a.dddq_max, b.dddq_max) &&
         same(a.tau_rate_max, b.tau_rate_max);
}

std::string list(const Eigen::Ref<const Eigen::VectorXd>& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "[" : ", ") + exact(value);
  return text + "]";
}

std::string text_of(const Placement& placement) {
  return "{position_m: " + list(placement.position) + ", rpy_rad: " + list(placement.rpy) + "}";
}

std::string text_of(const RigidBody& body) {
  const Matrix3& I = body.inertia;
  return "{mass_kg: " + exact(body.mass) + ", com_m: " + list(body.com) +
         ",\n          inertia_kg_m2: {xx: " + exact(I(0, 0)) + ", yy: " + exact(I(1, 1)) +
         ", zz: " + exact(I(2, 2)) + ", xy: " + exact(I(0, 1)) + ", xz: " + exact(I(0, 2)) +
         ", yz: " + exact(I(1, 2)) + "}}";
}

std::string text_of(const JointFriction& sigmoid, const std::string& indent) {
  return indent + "p1_nm: " + list(sigmoid.p1) + "\n" + indent + "p2_s_per_rad: " + list(sigmoid.p2) + "\n" +
         indent + "p3_rad_per_s: " + list(sigmoid.p3) + "\n";
}

std::string text_of(const FrictionLaw& law) {
  std::string text;
  if (law.offset.size() > 0) text += "  offset_nm: " + list(law.offset) + "\n";
  if (law.viscous.size() > 0) text += "  viscous_nm_s_per_rad: " + list(law.viscous) + "\n";
  if (law.stribeck.size() > 0) text += "  stribeck_nm: " + list(law.stribeck) + "\n";
  if (!law.presliding.empty()) text += "  presliding:\n";
  for (const auto& element : law.presliding) {
    text += "    - {distance_rad: " + exact(element.distance) + ", amplitude_nm: " + list(element.amplitude) +
            "}\n";
  }
  if (law.sigmoid) text += "  sigmoid:\n" + text_of(*law.sigmoid, "    ");
  return text.empty() ? " {}\n" : "\n" + text;
}

std::string text_of(const TorqueSensor& sensor) {
  std::string text = "\n";
  if (sensor.gain.size() > 0) text += "  gain: " + list(sensor.gain) + "\n";
  if (sensor.offset.size() > 0) text += "  offset_nm: " + list(sensor.offset) + "\n";
  return text + "  noise_nm: " + exact(sensor.noise) + "\n";
}

std::string text_of(const Actuation& actuation) {
  return "\n  torque_bandwidth_hz: " + exact(actuation.torque_bandwidth_hz) +
         "\n  command_delay_s: " + exact(actuation.command_delay) + "\n";
}

std::string text_of(const IdentifiedRange& range) {
  return "\n  lower_rad: " + list(range.q_min) + "\n  upper_rad: " + list(range.q_max) +
         "\n  velocity_rad_per_s: " + list(range.dq_max) + "\n" +
         (range.rmse.size() > 0 ? "  expected_rmse_nm: " + list(range.rmse) + "\n" : std::string());
}

// `word`: placeholder for a section of the base that the robot removes.
template <class T>
std::string optional_section(const char* key, const std::optional<T>& section) {
  return std::string(key) + ":" + (section ? text_of(*section) : " none\n");
}

// Reference to the base in a file in `folder`: a robot name for robots of models/, otherwise a path, relative
// if in the same folder.
std::string name_of(const fs::path& base, const fs::path& folder) {
  const fs::path absolute = fs::weakly_canonical(base);
  const bool known = fs::weakly_canonical(models_folder()) == absolute.parent_path();
  if (known && !fs::exists(folder / absolute.filename())) return absolute.stem().string();
  const fs::path relative = absolute.lexically_relative(fs::weakly_canonical(folder));
  return !relative.empty() && *relative.begin() != ".." ? relative.string() : absolute.string();
}

std::string whole_text(const RobotDescription& robot, const RobotDescription& base, const fs::path& folder) {
  std::string text = "name: " + yaml_quoted(robot.name) + "\ntitle: " + yaml_quoted(robot.title) +
                     "\nbase: " + yaml_quoted(name_of(base.file, folder)) + "\n";
  std::string notes;
  for (const auto& [section, note] : robot.origin) {
    const auto below = base.origin.find(section);
    if (below == base.origin.end() || below->second != note) {
      notes += "  " + yaml_quoted(section) + ": " + yaml_quoted(note) + "\n";
    }
  }
  if (!notes.empty()) text += "origin:\n" + notes;
  text += "\n";
  if (!same(robot.joints, base.joints)) {
    text += "joints:\n";
    for (std::size_t j = 0; j < robot.joint_count(); ++j) {
      std::string joint = text_of(robot.joints[j]);
      if (robot.is_prismatic(j)) joint.insert(joint.size() - 1, ", type: prismatic");
      text += "  joint" + std::to_string(j + 1) + ": " + joint + "\n";
    }
  }
  if (!same(robot.flange, base.flange)) text += "flange: " + text_of(robot.flange) + "\n";
  if (!same(robot.links, base.links)) {
    text += "inertials:\n";
    for (std::size_t i = 0; i < robot.links.size(); ++i) {
      text += "  link" + std::to_string(i) + ": " + text_of(robot.links[i]) + "\n";
    }
  }
  if (!same(robot.friction, base.friction)) {
    text += "joint_friction:" + (robot.friction ? "\n" + text_of(*robot.friction, "  ") : " none\n");
  }
  if (!same(robot.link_friction, base.link_friction)) {
    text += optional_section("link_friction", robot.link_friction);
  }
  if (!same(robot.torque_sensor, base.torque_sensor)) {
    text += optional_section("torque_sensor", robot.torque_sensor);
  }
  if (!same(robot.actuation, base.actuation)) text += optional_section("actuation", robot.actuation);
  if (!same(robot.identified_range, base.identified_range)) {
    text += optional_section("identified_range", robot.identified_range);
  }
  if (!same(robot.motor_inertia, base.motor_inertia)) {
    text += "motor_inertia_kg_m2: " +
            (robot.motor_inertia.size() > 0 ? list(robot.motor_inertia) : std::string("none")) + "\n";
  }
  if (!same(robot.rotor_inertia, base.rotor_inertia)) {
    text += "rotor_inertia_kg_m2: " +
            (robot.rotor_inertia.size() > 0 ? list(robot.rotor_inertia) : std::string("none")) + "\n";
  }
  if (robot.base_tilt != base.base_tilt) text += "base_tilt_rad: " + list(robot.base_tilt) + "\n";
  if (robot.rated_payload != base.rated_payload) {
    text += "rated_payload_kg: " + (robot.rated_payload ? exact(*robot.rated_payload) : std::string("none")) +
            "\n";
  }
  if (!same(robot.q_home, base.q_home)) text += "home_rad: " + list(robot.q_home) + "\n";
  return text;
}

void check(const RobotDescription& robot, const RobotDescription& base) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument("robot '" + robot.name + "' cannot be written: " + why);
  };
  if (base.file.empty()) refuse("its base '" + base.name + "' was not read from a file");
  if (robot.joint_count() != base.joint_count() || robot.links.size() != base.links.size()) {
    refuse("it has " + std::to_string(robot.joint_count()) + " joints, its base " +
           std::to_string(base.joint_count()));
  }
  for (std::size_t j = 0; j < robot.joint_count(); ++j) {
    if (robot.is_prismatic(j) != base.is_prismatic(j))
      refuse("joint" + std::to_string(j + 1) + " is prismatic in one of them and revolute in the other");
  }
  if (!same(robot.limits, base.limits)) refuse("its limits differ from those of its base");
  if (!same(robot.hand, base.hand)) refuse("its hand differs from that of its base");
}

}  // namespace

void write_robot(const RobotDescription& robot, const RobotDescription& base, const fs::path& file) {
  check(robot, base);
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  fs::create_directories(folder);
  // Written to the folder of the final file, because the base may be relative to it.
  const fs::path draft = folder / (file.filename().string() + "." + std::to_string(::getpid()));
  {
    std::ofstream out(draft, std::ios::binary);
    out << whole_text(robot, base, folder);
    if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
  }
  try {
    (void)load_robot(draft.string());
    fs::rename(draft, file);
  } catch (...) {
    std::error_code gone;
    fs::remove(draft, gone);
    throw;
  }
}

}  // namespace multipanda
