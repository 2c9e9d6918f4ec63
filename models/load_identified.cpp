#include "models/load_identified.hpp"

#include "models/load_parts.hpp"

namespace multipanda {
namespace {

double not_negative(const CheckedYaml& yaml) {
  const double value = yaml.number();
  if (value < 0) yaml.refuse("expected a number of at least 0, found '" + yaml.text() + "'");
  return value;
}

// What would drive a joint, were it negative.
JointVector joint_amplitudes(const CheckedYaml& yaml, std::size_t n) {
  for (const auto& item : yaml.items()) (void)not_negative(item);
  return joint_vector(yaml, n);
}

}  // namespace

bool is_taken_away(const CheckedYaml& section) { return section.is_word("none"); }

JointFriction read_sigmoid(const CheckedYaml& section, std::size_t n) {
  section.allow_keys({"p1_nm", "p2_s_per_rad", "p3_rad_per_s"});
  return {joint_amplitudes(section.at("p1_nm"), n), joint_amplitudes(section.at("p2_s_per_rad"), n),
          joint_vector(section.at("p3_rad_per_s"), n)};
}

FrictionLaw read_link_friction(const CheckedYaml& section, std::size_t n) {
  section.allow_keys({"offset_nm", "viscous_nm_s_per_rad", "stribeck_nm", "presliding", "sigmoid"});
  FrictionLaw law;
  if (const auto offset = section.find("offset_nm")) law.offset = joint_vector(*offset, n);
  if (const auto viscous = section.find("viscous_nm_s_per_rad")) law.viscous = joint_amplitudes(*viscous, n);
  if (const auto stribeck = section.find("stribeck_nm")) law.stribeck = joint_amplitudes(*stribeck, n);
  if (const auto presliding = section.find("presliding")) {
    for (const auto& item : presliding->items()) {
      item.allow_keys({"distance_rad", "amplitude_nm"});
      law.presliding.push_back(
          {item.at("distance_rad").positive(), joint_amplitudes(item.at("amplitude_nm"), n)});
    }
  }
  if (const auto sigmoid = section.find("sigmoid")) law.sigmoid = read_sigmoid(*sigmoid, n);
  return law;
}

TorqueSensor read_torque_sensor(const CheckedYaml& section, std::size_t n) {
  section.allow_keys({"gain", "offset_nm", "noise_nm"});
  TorqueSensor sensor;
  if (const auto gain = section.find("gain")) {
    for (const auto& item : gain->items()) (void)item.positive();
    sensor.gain = joint_vector(*gain, n);
  }
  if (const auto offset = section.find("offset_nm")) sensor.offset = joint_vector(*offset, n);
  if (const auto noise = section.find("noise_nm")) sensor.noise = not_negative(*noise);
  return sensor;
}

Actuation read_actuation(const CheckedYaml& section) {
  section.allow_keys({"torque_bandwidth_hz", "command_delay_s"});
  Actuation actuation;
  if (const auto bandwidth = section.find("torque_bandwidth_hz")) {
    actuation.torque_bandwidth_hz = not_negative(*bandwidth);
  }
  if (const auto delay = section.find("command_delay_s")) {
    constexpr double kLongest = 1.0;  // [s] somebody wrote milliseconds
    actuation.command_delay = not_negative(*delay);
    if (actuation.command_delay > kLongest) {
      delay->refuse("expected at most 1 s, found '" + delay->text() + "', which looks like milliseconds");
    }
  }
  return actuation;
}

JointVector read_motor_inertia(const CheckedYaml& section, std::size_t n) {
  return joint_amplitudes(section, n);
}

Eigen::Vector2d read_base_tilt(const CheckedYaml& section) {
  const auto values = section.numbers(2);
  for (const auto& item : section.items()) (void)item.angle();
  return {values[0], values[1]};
}

}  // namespace multipanda
