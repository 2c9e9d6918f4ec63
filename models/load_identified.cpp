#include "models/load_parts.hpp"

// The sections of a model file that describe an individual arm, as found by identification
// (docs/models.md).
namespace multipanda {

void visit(Archive& archive, JointFriction& friction, const std::size_t& n) {
  archive(Key("p1_nm").at_least(0).joints(n).required(), friction.p1);
  archive(Key("p2_s_per_rad").at_least(0).joints(n).required(), friction.p2);
  archive(Key("p3_rad_per_s").joints(n).required(), friction.p3);
}

void visit(Archive& archive, PreslidingElement& element, const std::size_t& n) {
  archive(Key("distance_rad").above(0).required(), element.distance);
  archive(Key("amplitude_nm").at_least(0).joints(n).required(), element.amplitude);
}

void visit(Archive& archive, FrictionLaw& law, const std::size_t& n) {
  archive(Key("offset_nm").joints(n), law.offset);
  archive(Key("viscous_nm_s_per_rad").at_least(0).joints(n), law.viscous);
  archive(Key("stribeck_nm").at_least(0).joints(n), law.stribeck);
  archive.list(Key("presliding"), law.presliding, n);
  archive.section(Key("sigmoid"), law.sigmoid, n);
}

void visit(Archive& archive, TorqueSensor& sensor, const std::size_t& n) {
  archive(Key("gain").above(0).joints(n), sensor.gain);
  archive(Key("offset_nm").joints(n), sensor.offset);
  archive(Key("noise_nm").at_least(0), sensor.noise);
}

void visit(Archive& archive, Actuation& actuation) {
  archive(Key("torque_bandwidth_hz").at_least(0), actuation.torque_bandwidth_hz);
  archive(Key("command_delay_s").at_least(0), actuation.command_delay);
  constexpr double kLongest = 1.0;  // [s]
  if (actuation.command_delay > kLongest) {
    archive.at("command_delay_s").expected("at most 1 s (a larger number looks like milliseconds)");
  }
}

}  // namespace multipanda
