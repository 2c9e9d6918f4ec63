#include "generators/yaml_pose.hpp"

#include <cstdlib>
#include <numbers>
#include <regex>

namespace multipanda {

double read_angle(const CheckedYaml& entry) {
  static const std::regex form(R"(\s*(-?)(?:([0-9.]+)\*)?pi(?:/([0-9.]+))?\s*)");
  std::smatch parts;
  const std::string text = entry.text();
  if (!std::regex_match(text, parts, form)) return entry.angle();
  const auto number = [&](std::size_t i) {
    return parts[i].matched ? std::atof(parts[i].str().c_str()) : 1.0;
  };
  if (!(number(3) > 0)) entry.refuse("expected an angle, found '" + text + "'");
  return (parts[1].length() > 0 ? -1 : 1) * number(2) / number(3) * std::numbers::pi;
}

Pose read_pose(const CheckedYaml& map) {
  map.allow_keys({"position_m", "rpy_rad"});
  Pose X;
  X.position = map.at("position_m").vector3();
  const auto angles = map.at("rpy_rad").items();
  if (angles.size() != 3)
    map.at("rpy_rad").refuse("expected 3 angles [rad], found " + std::to_string(angles.size()));
  X.rotation = rotation_from_rpy({read_angle(angles[0]), read_angle(angles[1]), read_angle(angles[2])});
  return X;
}

}  // namespace multipanda
