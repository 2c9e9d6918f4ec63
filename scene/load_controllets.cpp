#include <algorithm>
#include <cmath>
#include <utility>

#include "core/features/friction_compensation.hpp"
#include "scene/load_parts.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

std::vector<std::string> type_names(const Registry& registry) {
  std::vector<std::string> names;
  for (const auto& type : registry.controllets()) names.push_back(type.statement.type);
  return names;
}

std::vector<std::string> feature_names(const Registry& registry) {
  std::vector<std::string> names;
  for (const auto& type : registry.features()) names.push_back(type.statement.type);
  return names;
}

std::vector<std::string> parameter_names(const Statement& statement, const std::string& prefix = "") {
  std::vector<std::string> names;
  for (const auto& parameter : statement.parameters) names.push_back(prefix + parameter.name);
  return names;
}

const ParameterSpec* find_spec(const Statement& statement, const std::string& name) {
  const auto& specs = statement.parameters;
  const auto it =
      std::find_if(specs.begin(), specs.end(), [&](const auto& spec) { return spec.name == name; });
  return it == specs.end() ? nullptr : &*it;
}

[[noreturn]] void refuse_parameter(const Entry& at, const std::string& owner, const std::string& name,
                                   const std::vector<std::string>& valid) {
  const auto meant = same_quantity(name, valid);
  at.refuse(owner + " has no parameter " + in_quotes(name) +
            (meant.empty() ? name_hint(name, valid, "it has none")
                           : "; with its unit it is '" + joined(meant, "' or '") + "'"));
}

void read_feature_parameters(const FeatureType& feature, const Entry& values, SceneReader& reader,
                             InstanceConfig& config) {
  for (const auto& [name, value] : pairs_of(values)) {
    const ParameterSpec* spec = find_spec(feature.statement, name);
    if (spec == nullptr) {
      refuse_parameter(value, "feature '" + feature.statement.type + "'", name,
                       parameter_names(feature.statement));
    }
    config.parameters.push_back(
        {feature.statement.type + "." + name, read_parameter(value, *spec, reader.joint_count(config))});
  }
}

void read_parameters(const Entry& values, SceneReader& reader, InstanceConfig& config) {
  for (const auto& [name, value] : pairs_of(values)) {
    const FeatureType* feature = reader.registry.feature(name);
    if (feature != nullptr) {
      read_feature_parameters(*feature, value, reader, config);
      continue;
    }
    const ParameterSpec& spec = find_parameter(reader, config, value, name);
    config.parameters.push_back({name, read_parameter(value, spec, reader.joint_count(config))});
  }
  for (std::size_t i = 0; i < config.parameters.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (config.parameters[i].name == config.parameters[k].name) {
        values.refuse("parameter '" + config.parameters[i].name + "' is given twice, nested and with a dot");
      }
    }
  }
}

void read_inputs(const Entry& inputs, const Statement& statement, InstanceConfig& config) {
  for (const auto& [name, value] : pairs_of(inputs)) {
    const auto it = std::find_if(statement.inputs.begin(), statement.inputs.end(),
                                 [&, wanted = name](const auto& input) { return input.name == wanted; });
    if (it == statement.inputs.end()) {
      std::vector<std::string> valid;
      for (const auto& input : statement.inputs) valid.push_back(input.name);
      value.refuse("'" + config.type + "' has no input " + in_quotes(name) +
                   name_hint(name, valid, "it has none"));
    }
    InputSpec spec = *it;
    const bool pose = spec.quantity == Quantity::pose, joints = spec.quantity == Quantity::joints;
    const Mapping mapping(value, pose     ? schema::pose_input()
                                 : joints ? schema::joints_input()
                                          : schema::other_input());
    const std::string speed = pose ? "max_speed_m_per_s" : joints ? "max_speed_rad_per_s" : "max_rate_per_s";
    if (mapping.has("timeout_s")) spec.timeout_s = mapping.number("timeout_s");
    if (mapping.has(speed)) spec.max_speed = mapping.number(speed);
    if (pose && mapping.has("max_angular_speed_rad_per_s")) {
      spec.max_angular_speed = mapping.number("max_angular_speed_rad_per_s");
    }
    config.inputs.push_back(std::move(spec));
  }
}

void read_arm_list(const Mapping& mapping, const Statement& statement, const SceneReader& reader,
                   InstanceConfig& config) {
  for (const auto& name : mapping.text_items("arms")) {
    const ArmIndex arm = reader.arm(name);
    if (std::find(config.arms.begin(), config.arms.end(), arm) != config.arms.end()) {
      name.refuse("the arm " + in_quotes(name.node().Scalar()) + " is named twice");
    }
    config.arms.push_back(arm);
  }
  if (config.arms.size() != statement.arms) {
    mapping.entry("arms").refuse("'" + config.type + "' owns " + std::to_string(statement.arms) +
                                 (statement.arms == 1 ? " arm" : " arms") + ", found " +
                                 std::to_string(config.arms.size()));
  }
}

// A scene may give an arm's built-in hold parameters and features by declaring it.
void take_over_hold(const Mapping& mapping, const InstanceConfig& config, SceneReader& reader) {
  const auto hold = std::find_if(reader.holds.begin(), reader.holds.end(),
                                 [&](const auto& candidate) { return candidate.name == config.name; });
  if (hold == reader.holds.end()) return;
  if (config.type != "hold" || config.arms != hold->arms) {
    mapping.entry("name").refuse("this name belongs to the built-in hold of arm '" +
                                 reader.scene.arms[hold->arms[0]].name +
                                 "'; expected type 'hold' and that arm, or another name");
  }
  reader.holds.erase(hold);
}

InstanceConfig read_controllet(Mapping mapping, SceneReader& reader) {
  InstanceConfig config;
  config.name = mapping.text("name");
  mapping.rename("controllet '" + config.name + "'");
  if (const auto it = reader.scene.controllet_places.find(config.name);
      it != reader.scene.controllet_places.end()) {
    mapping.entry("name").refuse("two controllets have this name, the first in line " +
                                 std::to_string(it->second.line));
  }
  config.type = mapping.text("type");
  const ControlletType* type = reader.registry.controllet(config.type);
  if (type == nullptr) {
    mapping.entry("type").refuse("there is no controllet type " + in_quotes(config.type) +
                                 name_hint(config.type, type_names(reader.registry), "there are none"));
  }
  read_arm_list(mapping, type->statement, reader, config);
  for (const auto& name : mapping.text_items("features")) {
    check_feature(reader, config, name);
    const std::string& feature = name.node().Scalar();
    if (std::find(config.features.begin(), config.features.end(), feature) != config.features.end()) {
      name.refuse("the feature " + in_quotes(feature) + " is named twice");
    }
    config.features.push_back(feature);
  }
  take_over_hold(mapping, config, reader);
  if (mapping.has("parameters")) read_parameters(mapping.entry("parameters"), reader, config);
  if (mapping.has("inputs")) read_inputs(mapping.entry("inputs"), type->statement, config);
  reader.scene.controllet_places[config.name] = mapping.self().place();
  return config;
}

double read_choice(const Entry& value, const ParameterSpec& spec) {
  Field field{.kind = FieldKind::choice, .choices = spec.choices};
  const std::string name = value.text(field);
  return static_cast<double>(std::find(spec.choices.begin(), spec.choices.end(), name) -
                             spec.choices.begin());
}

}  // namespace

const ParameterSpec& find_parameter(const SceneReader& reader, const InstanceConfig& instance,
                                    const Entry& at, const std::string& name) {
  const Statement& statement = reader.registry.controllet(instance.type)->statement;
  const std::size_t dot = name.find('.');
  if (dot == std::string::npos) {
    if (const ParameterSpec* spec = find_spec(statement, name)) return *spec;
    std::vector<std::string> valid = parameter_names(statement);
    const auto features = feature_names(reader.registry);
    if (nearest_name(name, valid).empty() && same_quantity(name, valid).empty()) {
      valid.insert(valid.end(), features.begin(), features.end());  // perhaps a feature's mapping was meant
    }
    refuse_parameter(at, "'" + instance.type + "'", name, valid);
  }
  const std::string feature_name = name.substr(0, dot), parameter = name.substr(dot + 1);
  const FeatureType* feature = reader.registry.feature(feature_name);
  if (feature == nullptr) {
    at.refuse("there is no feature " + in_quotes(feature_name) +
              name_hint(feature_name, feature_names(reader.registry), "there are none"));
  }
  const ParameterSpec* spec = find_spec(feature->statement, parameter);
  if (spec == nullptr) {
    refuse_parameter(at, "feature '" + feature_name + "'", parameter, parameter_names(feature->statement));
  }
  return *spec;
}

std::vector<double> read_parameter(const Entry& value, const ParameterSpec& spec, std::size_t joint_count) {
  const std::size_t count = spec.size == ParameterSpec::kPerJoint ? joint_count : spec.size;
  const bool list = value.is_list();
  std::vector<double> values;
  if (!spec.choices.empty()) {
    if (list) {
      for (const auto& item : value.items()) values.push_back(read_choice(item, spec));
    } else {
      values = {read_choice(value, spec)};
    }
  } else {
    const Field field{.kind = FieldKind::number, .unit = spec.unit, .min = spec.min, .max = spec.max};
    if (list && count == 1 && value.node().size() == 1) value.expected(expectation(field));
    values = list ? value.numbers(field, count) : std::vector<double>{value.number(field)};
  }
  if (values.size() == 1) values.resize(count, values[0]);
  if (values.size() != count) value.expected(std::to_string(count) + " values");
  return values;
}

void check_feature(const SceneReader& reader, const InstanceConfig& instance, const Entry& name) {
  const std::string& feature = name.node().Scalar();
  if (reader.registry.feature(feature) == nullptr) {
    name.refuse("there is no feature " + in_quotes(feature) +
                name_hint(feature, feature_names(reader.registry), "there are none"));
  }
  if (feature != friction_compensation_feature().statement.type) return;
  for (const ArmIndex index : instance.arms) {
    const SceneArm& arm = reader.scene.arms[index];
    if (arm.known_friction) continue;
    name.refuse("nothing is known of the joint friction of arm " + in_quotes(arm.name) +
                "; give that arm 'known_friction: model', or leave the feature out");
  }
}

SceneReader::SceneReader(const Registry& types) : registry(types) {}

std::vector<std::string> SceneReader::instance_names() const {
  std::vector<std::string> names;
  for (const auto& config : scene.controllets) names.push_back(config.name);
  for (const auto& hold : holds) names.push_back(hold.name);
  return names;
}

const InstanceConfig& SceneReader::instance(const Entry& name) const {
  const std::string& wanted = name.node().Scalar();
  for (const auto& config : scene.controllets) {
    if (config.name == wanted) return config;
  }
  for (const auto& hold : holds) {
    if (hold.name == wanted) return hold;
  }
  name.refuse("there is no controllet " + in_quotes(wanted) +
              name_hint(wanted, instance_names(), "there are none"));
}

ArmSet arms_of(const InstanceConfig& instance) {
  ArmSet arms;
  for (const ArmIndex arm : instance.arms) arms |= ArmSet::of(arm);
  return arms;
}

std::vector<const InstanceConfig*> read_owners(const SceneReader& reader, const std::vector<Entry>& names) {
  std::vector<const InstanceConfig*> owners;
  for (const auto& name : names) {
    const InstanceConfig& config = reader.instance(name);
    for (const InstanceConfig* other : owners) {
      if (other == &config) name.refuse("the controllet " + in_quotes(config.name) + " is named twice");
      const ArmSet both = arms_of(*other) & arms_of(config);
      if (both.empty()) continue;
      name.refuse("arm '" + reader.scene.arms[both.first()].name + "' would have two owners: '" +
                  other->name + "' and '" + config.name + "'; expected at most one, leave one of them out");
    }
    owners.push_back(&config);
  }
  return owners;
}

void read_controllets(const Mapping& root, SceneReader& reader) {
  const auto items = root.items("controllets");
  const std::size_t most = kMaxInstances - reader.scene.arms.size();
  std::size_t number = 0;
  for (const auto& item : items) {
    Mapping mapping(item.as("controllet " + std::to_string(++number)), schema::controllet());
    InstanceConfig config = read_controllet(std::move(mapping), reader);
    reader.scene.controllets.push_back(std::move(config));
  }
  if (reader.scene.controllets.size() + reader.holds.size() > kMaxInstances) {
    root.entry("controllets")
        .refuse("expected at most " + std::to_string(most) + " (" + std::to_string(kMaxInstances) +
                " with the arms' holds), found " + std::to_string(reader.scene.controllets.size()));
  }
}

void read_active(const Mapping& root, SceneReader& reader) {
  for (const InstanceConfig* owner : read_owners(reader, root.text_items("active"))) {
    reader.scene.active.push_back(owner->name);
  }
}

}  // namespace multipanda
