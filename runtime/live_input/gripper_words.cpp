#include "runtime/live_input/gripper_words.hpp"

#include <algorithm>
#include <cmath>

#include "scene/names.hpp"

namespace multipanda {
namespace {

struct Action {
  std::string name;
  std::vector<std::string> keys;
};

// The action, known, and no key beside its own.
std::string read_action(const JsonFields& fields, std::vector<std::string> keys,
                        const std::vector<Action>& actions) {
  const std::string name = fields.text("action");
  std::vector<std::string> names;
  for (const Action& action : actions) {
    names.push_back(action.name);
    if (action.name != name) continue;
    keys.insert(keys.end(), {"arm", "action"});
    keys.insert(keys.end(), action.keys.begin(), action.keys.end());
    fields.allow(keys);
    return name;
  }
  fields.refuse("there is no action '" + name.substr(0, 60) + "'" + name_hint(name, names, "there is none"));
}

double read_positive(const JsonFields& fields, const std::string& key, double fallback) {
  const double value = fields.number(key, fallback);
  if (!std::isfinite(value) || value <= 0) fields.expected(key, "a number above 0");
  return value;
}

double read_not_negative(const JsonFields& fields, const std::string& key, double value) {
  if (!std::isfinite(value) || value < 0) fields.expected(key, "a number of 0 or more");
  return value;
}

}  // namespace

ArmRequest read_gripper_request(const JsonFields& fields, std::vector<std::string> common_keys) {
  static const std::vector<Action> kActions = {
      {"homing", {}},
      {"move", {"width_m", "speed_m_per_s"}},
      {"grasp",
       {"width_m", "speed_m_per_s", "force_n", "tolerance_m", "tolerance_inner_m", "tolerance_outer_m"}},
      {"stop", {}}};
  const std::string action = read_action(fields, std::move(common_keys), kActions);
  if (action == "homing") return GripperHoming{};
  if (action == "stop") return GripperStop{};
  const double width = read_not_negative(fields, "width_m", fields.number("width_m"));
  const double speed = read_positive(fields, "speed_m_per_s", GripperMove{}.speed);
  if (action == "move") return GripperMove{width, speed};
  GripperGrasp grasp{.width = width, .speed = speed};
  grasp.force = read_positive(fields, "force_n", grasp.force);
  const double both = fields.number("tolerance_m", grasp.tolerance_inner);
  const auto tolerance = [&](const std::string& key) {
    return read_not_negative(fields, fields.has(key) ? key : "tolerance_m", fields.number(key, both));
  };
  grasp.tolerance_inner = tolerance("tolerance_inner_m");
  grasp.tolerance_outer = tolerance("tolerance_outer_m");
  return grasp;
}

ArmRequest read_vacuum_request(const JsonFields& fields, std::vector<std::string> common_keys) {
  static const std::vector<Action> kActions = {
      {"on", {"vacuum_mbar", "timeout_s"}}, {"drop", {"timeout_s"}}, {"stop", {}}};
  const std::string action = read_action(fields, std::move(common_keys), kActions);
  if (action == "stop") return VacuumStop{};
  const double timeout = read_positive(fields, "timeout_s", VacuumOn{}.timeout_s);
  if (action == "drop") return VacuumDrop{timeout};
  return VacuumOn{read_positive(fields, "vacuum_mbar", VacuumOn{}.pressure_mbar), timeout};
}

nlohmann::json gripper_words(const ArmSample& sample) {
  return {{"width_m", sample.gripper_width},
          {"max_width_m", sample.gripper_max_width},
          {"grasped", sample.gripper_grasped},
          {"moving", sample.gripper_moving}};
}

}  // namespace multipanda
