#include "models/export_list.hpp"

#include "models/to_mjcf.hpp"
#include "models/to_urdf.hpp"

namespace multipanda {

std::map<std::string, std::string> exported_models() {
  std::map<std::string, std::string> files;
  for (const auto& name : available_robots()) {
    const RobotDescription robot = load_robot(name);
    files[name + ".urdf"] = to_urdf(robot);
    files[name + ".xml"] = to_mjcf(robot, {.rotor_hidden = 0});
    if (!robot.hand) continue;
    files[name + "_hand.urdf"] = to_urdf(robot, {.hand = true});
    files[name + "_hand.xml"] = to_mjcf(robot, {.hand = true, .rotor_hidden = 0});
  }
  return files;
}

}  // namespace multipanda
