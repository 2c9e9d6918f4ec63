#pragma once

#include <string>

namespace multipanda::test {

inline constexpr double kCarriageMass = 25;  // [kg]

// The URDF of a Panda (links panda_link0, ...) with a linear axis under it: the link `rail` along y, and a
// carriage that slides on it by the joint `axis`, -1 to 1 m.
inline std::string panda_on_axis(std::string panda) {
  const std::string axis = R"(
    <link name="rail">
      <inertial><origin xyz="0 0 -0.1"/><mass value="80"/>
        <inertia ixx="40" ixy="0" ixz="0" iyy="1" iyz="0" izz="40"/></inertial>
      <collision><origin xyz="0 0 -0.1"/><geometry><box size="0.2 2.4 0.2"/></geometry></collision>
    </link>
    <link name="carriage">
      <inertial><origin xyz="0.01 0.02 0.03"/><mass value="25"/>
        <inertia ixx="0.3" ixy="0.01" ixz="0" iyy="0.4" iyz="0.02" izz="0.5"/></inertial>
      <collision><origin xyz="0 0 0.04"/><geometry><box size="0.3 0.3 0.08"/></geometry></collision>
    </link>
    <joint name="axis" type="prismatic">
      <parent link="rail"/><child link="carriage"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" velocity="1" effort="800"/>
    </joint>
    <joint name="plate" type="fixed">
      <parent link="carriage"/><child link="panda_link0"/><origin xyz="0 0 0.08"/>
    </joint>
  )";
  const std::string end = "</robot>";
  return panda.insert(panda.rfind(end), axis);
}

}  // namespace multipanda::test
