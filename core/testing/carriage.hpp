// A carriage on a tilted linear axis, the smallest arm with a prismatic joint.
#pragma once

#include <memory>
#include <string>

#include "core/model/arm_model.hpp"
#include "core/types/spatial.hpp"

namespace multipanda::test {

// A carriage of `mass` on a tilted axis, and on it, if `turns`, an arm of one link.
inline std::shared_ptr<const ArmModel> axis(double mass, bool turns = false) {
  const auto link = [](const char* name, double m) {
    const std::string kg = std::to_string(m);
    return std::string("<link name='") + name + "'><inertial><origin xyz='0.1 0 0.05'/><mass value='" + kg +
           "'/><inertia ixx='0.2' ixy='0' ixz='0' iyy='0.2' iyz='0' izz='0.2'/></inertial></link>";
  };
  std::string urdf = "<robot name='axis'><link name='base'/>" + link("carriage", mass) +
                     "<joint name='slide' type='prismatic'><parent link='base'/><child link='carriage'/>"
                     "<origin xyz='0.3 0 0.2' rpy='0.4 0.2 0.1'/><axis xyz='0 0.6 0.8'/>"
                     "<limit lower='-0.5' upper='0.7' velocity='1' effort='900'/></joint>";
  if (turns) {
    urdf += link("boom", 4) +
            "<joint name='turn' type='revolute'><parent link='carriage'/><child link='boom'/>"
            "<axis xyz='0 0 1'/><limit lower='-2' upper='2' velocity='2' effort='80'/></joint>";
  }
  ArmModelSource source;
  source.name = "axis";
  source.urdf = urdf + "</robot>";
  source.flange = turns ? "boom" : "carriage";
  source.X_WB = {rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}};
  return std::make_shared<const ArmModel>(source);
}

inline JointVector one(double value) { return JointVector::Constant(1, value); }

}  // namespace multipanda::test
