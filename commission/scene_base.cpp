#include "commission/scene_base.hpp"

#include <stdexcept>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "commission/rigid_fit.hpp"

namespace multipanda::commission {

std::string with_base(const std::string& scene_text, const std::string& arm, const Pose& X_WB,
                      const std::string& note) {
  YAML::Node scene = YAML::Load(scene_text);
  bool found = false;
  for (YAML::Node entry : scene["arms"]) {
    if (!entry["name"] || entry["name"].as<std::string>() != arm) continue;
    const Vector3 rpy = rpy_of(X_WB.rotation);
    const auto row = [](const Vector3& v) {
      YAML::Node list(YAML::NodeType::Sequence);
      for (const double value : v) list.push_back(fmt::format("{:.7g}", value));
      list.SetStyle(YAML::EmitterStyle::Flow);
      return list;
    };
    YAML::Node base;
    base["position_m"] = row(X_WB.position);
    base["rpy_rad"] = row(rpy);
    entry["base"] = base;
    found = true;
  }
  if (!found) throw std::invalid_argument("the scene has no arm '" + arm + "' with a name of its own");
  YAML::Emitter out;
  out << scene;
  return "# " + note + "\n" + out.c_str() + "\n";
}

}  // namespace multipanda::commission
