#include <algorithm>
#include <set>
#include <utility>

#include "common/text.hpp"
#include "core/controllets/prismatic_parameters.hpp"
#include "core/features/builtins.hpp"
#include "scene/load_parts.hpp"

namespace multipanda {
namespace {

std::vector<std::string> type_names(const Registry& registry) {
  std::vector<std::string> names;
  for (const auto& type : registry.controllets()) names.push_back(type.descriptor.type);
  return names;
}

std::vector<std::string> feature_names(const Registry& registry) {
  std::vector<std::string> names;
  for (const auto& type : registry.features()) names.push_back(type.descriptor.type);
  return names;
}

std::vector<std::string> parameter_names(const ControlletDescriptor& descriptor,
                                         const std::string& prefix = "") {
  std::vector<std::string> names;
  for (const auto& parameter : descriptor.parameters) names.push_back(prefix + parameter.name);
  return names;
}

const ParameterSpec* find_spec(const ControlletDescriptor& descriptor, const std::string& name) {
  const auto& specs = descriptor.parameters;
  const auto it =
      std::find_if(specs.begin(), specs.end(), [&](const auto& spec) { return spec.name == name; });
  return it == specs.end() ? nullptr : &*it;
}

[[noreturn]] void refuse_parameter(const Node& at, const std::string& owner, const std::string& name,
                                   const std::vector<std::string>& valid) {
  const auto meant = same_quantity(name, valid);
  at.refuse(owner + " has no parameter " + in_quotes(name) +
            (meant.empty() ? name_hint(name, valid, "it has none")
                           : "; with its unit it is '" + joined(meant, "' or '") + "'"));
}

std::vector<std::string> preset_names(const ControlletDescriptor& descriptor) {
  std::vector<std::string> names;
  for (const Preset& preset : descriptor.presets) names.push_back(preset.name);
  return names;
}

// Values of a preset, except those that the scene sets itself.
void read_preset(const Node& node, const ControlletDescriptor& descriptor, const std::string& prefix,
                 const SceneReader& reader, InstanceConfig& config) {
  const std::string name = node.yaml().IsScalar() ? node.yaml().Scalar() : "";
  const auto preset = std::ranges::find(descriptor.presets, name, &Preset::name);
  if (preset == descriptor.presets.end()) {
    node.refuse("'" + descriptor.type + "' has no preset " + in_quotes(name) +
                name_hint(name, preset_names(descriptor), "it has none; remove this key"));
  }
  for (const Preset::Value& value : preset->values) {
    const std::string full = prefix + value.parameter;
    if (std::ranges::any_of(config.parameters, [&](const auto& given) { return given.name == full; }))
      continue;
    const ParameterSpec& spec = *find_spec(descriptor, value.parameter);
    const std::size_t count = spec.size == ParameterSpec::kPerJoint ? reader.joint_count(config) : spec.size;
    if (spec.size == ParameterSpec::kPerJoint && reader.robots[config.arms[0]].has_prismatic_joints()) {
      node.refuse("the preset " + in_quotes(name) + " gives '" + value.parameter +
                  "' for revolute joints, but the arm has a prismatic one with another unit; write the "
                  "preset's values as parameters, with suitable ones for that joint");
    }
    std::vector<double> values = value.values;
    if (values.size() > 1 && values.size() < count) {
      node.refuse("the preset " + in_quotes(name) + " is made for " + std::to_string(values.size()) +
                  " joints, found an arm with " + std::to_string(count));
    }
    values.resize(count, values[0]);
    config.parameters.push_back({full, std::move(values)});
  }
}

void read_feature_parameters(const FeatureType& feature, const Node& values, SceneReader& reader,
                             InstanceConfig& config) {
  for (const auto& [name, value] : values.pairs()) {
    if (name == "preset") continue;
    const ParameterSpec* spec = find_spec(feature.descriptor, name);
    if (spec == nullptr) {
      refuse_parameter(value, "feature '" + feature.descriptor.type + "'", name,
                       parameter_names(feature.descriptor));
    }
    config.parameters.push_back(
        {feature.descriptor.type + "." + name,
         read_parameter(value, spec_here(*spec, reader, config), reader.joint_count(config))});
  }
}

// Presets last, so that explicit values win regardless of their place in the scene.
void read_presets(const Node& values, const SceneReader& reader, InstanceConfig& config) {
  for (const auto& [name, value] : values.pairs()) {
    if (name == "preset")
      read_preset(value, reader.registry.controllet(config.type)->descriptor, "", reader, config);
    const FeatureType* feature = reader.registry.feature(name);
    if (feature == nullptr) continue;
    for (const auto& [key, preset] : value.pairs()) {
      if (key == "preset") read_preset(preset, feature->descriptor, name + ".", reader, config);
    }
  }
}

void read_parameters(const Node& values, SceneReader& reader, InstanceConfig& config) {
  for (const auto& [name, value] : values.pairs()) {
    if (name == "preset") continue;
    const FeatureType* feature = reader.registry.feature(name);
    if (feature != nullptr) {
      read_feature_parameters(*feature, value, reader, config);
      continue;
    }
    const ParameterSpec spec = spec_here(find_parameter(reader, config, value, name), reader, config);
    config.parameters.push_back({name, read_parameter(value, spec, reader.joint_count(config))});
  }
  std::set<std::string> seen;
  for (const auto& parameter : config.parameters) {
    if (!seen.insert(parameter.name).second)
      values.refuse("duplicate parameter '" + parameter.name + "', nested and with a dot; remove one");
  }
  read_presets(values, reader, config);
}

// Presets and options that give up a law's usual safeguards beside a person.
void note_options(const Node& values, const InstanceConfig& config, Scene& scene) {
  struct Option {
    const char *name, *text;
  };
  static constexpr Option kOptions[] = {
      {"force_may_pull", "force_may_pull: true, so a wrong estimate can pull the hand back"},
      {"force_feedback", "force_feedback: always, which pushes without contact"},
      {"valve_law", "valve_law: paper, which is not passive"},
      {"nullspace_damping_of", "nullspace_damping_of: joints, which may supply energy"}};
  for (const auto& [name, value] : values.pairs()) {
    if (name == "preset")
      scene.unsafer_laws.push_back("'" + config.name + "': preset " + in_quotes(value.yaml().Scalar()));
  }
  for (const auto& [name, text] : kOptions) {
    for (const auto& given : config.parameters) {
      if (given.name == name && given.values.at(0) != 0)
        scene.unsafer_laws.push_back("'" + config.name + "': " + text);
    }
  }
}

template <typename Input>
InputSpec overridden(const Node& node, const InputSpec& own) {
  Input input{own};
  Archive::read(node, input);
  return input;
}

// Reports requested speeds that are lowered.
void note_lowered_speed(const Node& node, const InputSpec& input, const InstanceConfig& config,
                        Scene& scene) {
  const double most = scene.contact_bounds.hand_speed;
  const bool named =
      std::ranges::any_of(node.pairs(), [](const auto& pair) { return pair.first == "max_speed_m_per_s"; });
  if (!named || input.quantity != Quantity::pose || input.max_speed <= most) return;
  scene.lowered.push_back("'" + config.name + "': max_speed_m_per_s " + number_text(input.max_speed) +
                          " of '" + input.name + "' is lowered to " + number_text(most) +
                          " m/s; a larger hand_speed_m_per_s in the scene's contact_bounds lifts it");
}

void read_inputs(const Node& inputs, const ControlletDescriptor& descriptor, Scene& scene,
                 InstanceConfig& config) {
  for (const auto& [name, value] : inputs.pairs()) {
    const auto own = std::find_if(descriptor.inputs.begin(), descriptor.inputs.end(),
                                  [&, &sought = name](const auto& input) { return input.name == sought; });
    if (own == descriptor.inputs.end())
      value.refuse(has_no(config.type, "input", name, names_in(descriptor.inputs)));
    config.inputs.push_back(own->quantity == Quantity::pose     ? overridden<PoseInput>(value, *own)
                            : own->quantity == Quantity::joints ? overridden<JointsInput>(value, *own)
                                                                : overridden<OtherInput>(value, *own));
    note_lowered_speed(value, config.inputs.back(), config, scene);
  }
}

Key timeout_key() {
  return Key("timeout_s", "A stream that is silent for longer is lost: its arms go to hold.")
      .within(0.002, 60)
      .no_default();
}

Key speed_key(const char* name, const char* doc) { return Key(name, doc).within(1e-4, 1e4).no_default(); }

void check_arms(const Archive& archive, const std::vector<Node>& names,
                const ControlletDescriptor& descriptor, const SceneReader& reader, InstanceConfig& config) {
  for (const auto& name : names) {
    const ArmIndex arm = reader.arm(name);
    if (std::find(config.arms.begin(), config.arms.end(), arm) != config.arms.end())
      name.refuse("the arm " + in_quotes(name.yaml().Scalar()) + " is named twice; remove one");
    config.arms.push_back(arm);
  }
  if (config.arms.size() != descriptor.arms) {
    archive.at("arms").refuse("expected " + std::to_string(descriptor.arms) +
                              (descriptor.arms == 1 ? " arm" : " arms") + ", which '" + config.type +
                              "' owns, found " + std::to_string(config.arms.size()));
  }
}

void check_observed(const Archive& archive, const std::vector<Node>& names,
                    const ControlletDescriptor& descriptor, const SceneReader& reader,
                    InstanceConfig& config) {
  for (const auto& name : names) {
    const ArmIndex arm = reader.arm(name);
    if (std::find(config.arms.begin(), config.arms.end(), arm) != config.arms.end())
      name.refuse("the controllet owns the arm " + in_quotes(name.yaml().Scalar()) +
                  "; expected another arm, which it only reads");
    if (std::find(config.observes.begin(), config.observes.end(), arm) != config.observes.end())
      name.refuse("the arm " + in_quotes(name.yaml().Scalar()) + " is named twice; remove one");
    config.observes.push_back(arm);
  }
  if (config.observes.size() == descriptor.observes) return;
  const Node at = names.empty() ? archive.at("type") : archive.at("observes");
  if (descriptor.observes == 0) at.refuse("'" + config.type + "' observes no arm; remove this key");
  at.refuse("expected the key 'observes' with " + std::to_string(descriptor.observes) +
            (descriptor.observes == 1 ? " arm" : " arms") + ", which '" + config.type +
            "' reads and does not own, found " + std::to_string(config.observes.size()));
}

void check_features(const std::vector<Node>& names, const SceneReader& reader, InstanceConfig& config) {
  for (const auto& name : names) {
    check_feature(reader, config, name);
    const std::string& feature = name.yaml().Scalar();
    if (std::find(config.features.begin(), config.features.end(), feature) != config.features.end())
      name.refuse("the feature " + in_quotes(feature) + " is named twice; remove one");
    config.features.push_back(feature);
  }
}

// A scene may declare an arm's built-in hold to give it parameters and features.
void replace_hold(const Archive& archive, const InstanceConfig& config, SceneReader& reader) {
  const auto hold = std::find_if(reader.holds.begin(), reader.holds.end(),
                                 [&](const auto& candidate) { return candidate.name == config.name; });
  if (hold == reader.holds.end()) return;
  if (config.type != "hold" || config.arms != hold->arms) {
    archive.at("name").refuse("this name belongs to the built-in hold of arm '" +
                              reader.scene.arms[hold->arms[0]].name +
                              "'; expected type 'hold' and that arm, or another name");
  }
  reader.holds.erase(hold);
}

const ControlletType& find_type(const Archive& archive, const std::string& type, const SceneReader& reader) {
  const ControlletType* found = reader.registry.controllet(type);
  if (found == nullptr) {
    archive.at("type").refuse("there is no controllet type " + in_quotes(type) +
                              name_hint(type, type_names(reader.registry), "there are none"));
  }
  return *found;
}

double read_choice(const Node& value, const ParameterSpec& spec) {
  Key key("", "");
  key.kind = Key::Kind::choice;
  const std::string name = value.text(key.one_of(spec.choices));
  return static_cast<double>(std::find(spec.choices.begin(), spec.choices.end(), name) -
                             spec.choices.begin());
}

}  // namespace

const ParameterSpec& find_parameter(const SceneReader& reader, const InstanceConfig& instance, const Node& at,
                                    const std::string& name) {
  const ControlletDescriptor& descriptor = reader.registry.controllet(instance.type)->descriptor;
  const std::size_t dot = name.find('.');
  if (dot == std::string::npos) {
    if (const ParameterSpec* spec = find_spec(descriptor, name)) return *spec;
    std::vector<std::string> valid = parameter_names(descriptor);
    const auto features = feature_names(reader.registry);
    if (nearest_name(name, valid).empty() && same_quantity(name, valid).empty()) {
      valid.insert(valid.end(), features.begin(), features.end());  // a mapping of a feature may have been
                                                                    // meant
    }
    refuse_parameter(at, "'" + instance.type + "'", name, valid);
  }
  const std::string feature_name = name.substr(0, dot), parameter = name.substr(dot + 1);
  const FeatureType* feature = reader.registry.feature(feature_name);
  if (feature == nullptr) {
    at.refuse("there is no feature " + in_quotes(feature_name) +
              name_hint(feature_name, feature_names(reader.registry), "there are none"));
  }
  const ParameterSpec* spec = find_spec(feature->descriptor, parameter);
  if (spec == nullptr) {
    refuse_parameter(at, "feature '" + feature_name + "'", parameter, parameter_names(feature->descriptor));
  }
  return *spec;
}

ParameterSpec spec_here(const ParameterSpec& spec, const SceneReader& reader, const InstanceConfig& config) {
  return reader.robots[config.arms[0]].has_prismatic_joints() ? with_prismatic_joints(spec) : spec;
}

std::vector<double> read_parameter(const Node& value, const ParameterSpec& spec, std::size_t joint_count) {
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
    Key key("", "");
    key.kind = Key::Kind::number;
    key.in(spec.unit).within(spec.min, spec.max).size(count);
    if (list && count == 1) value.expected(expectation(key));
    values = list ? value.numbers(key) : std::vector<double>{value.number(key)};
  }
  if (values.size() == 1) values.resize(count, values[0]);
  if (values.size() != count) value.expected(std::to_string(count) + " values");
  return values;
}

void check_feature(const SceneReader& reader, const InstanceConfig& instance, const Node& name) {
  const std::string& feature = name.yaml().Scalar();
  if (reader.registry.feature(feature) == nullptr) {
    name.refuse("there is no feature " + in_quotes(feature) +
                name_hint(feature, feature_names(reader.registry), "there are none"));
  }
  if (feature != friction_compensation_feature().descriptor.type) return;
  for (const ArmIndex index : instance.arms) {
    const SceneArm& arm = reader.scene.arms[index];
    if (arm.known_friction) continue;
    name.refuse("the joint friction of arm " + in_quotes(arm.name) +
                " is not known; add 'known_friction: model' to that arm, or remove the feature");
  }
}

std::vector<std::string> SceneReader::instance_names() const {
  std::vector<std::string> names;
  for (const auto& config : scene.controllets) names.push_back(config.name);
  for (const auto& hold : holds) names.push_back(hold.name);
  return names;
}

const InstanceConfig& SceneReader::instance(const Node& name) const {
  const std::string& requested = name.yaml().Scalar();
  for (const auto& config : scene.controllets) {
    if (config.name == requested) return config;
  }
  for (const auto& hold : holds) {
    if (hold.name == requested) return hold;
  }
  name.refuse("there is no controllet " + in_quotes(requested) +
              name_hint(requested, instance_names(), "there are none"));
}

ArmSet arms_of(const InstanceConfig& instance) {
  ArmSet arms;
  for (const ArmIndex arm : instance.arms) arms |= ArmSet::of(arm);
  return arms;
}

std::vector<const InstanceConfig*> read_owners(const SceneReader& reader, const std::vector<Node>& names) {
  std::vector<const InstanceConfig*> owners;
  for (const auto& name : names) {
    const InstanceConfig& config = reader.instance(name);
    for (const InstanceConfig* other : owners) {
      if (other == &config)
        name.refuse("the controllet " + in_quotes(config.name) + " is named twice; remove one");
      const ArmSet both = arms_of(*other) & arms_of(config);
      if (both.empty()) continue;
      name.refuse("arm '" + reader.scene.arms[both.first()].name + "' would have two owners: '" +
                  other->name + "' and '" + config.name + "'; remove one of them");
    }
    owners.push_back(&config);
  }
  return owners;
}

void visit(Archive& archive, PoseInput& input) {
  archive.about("Input (pose)", "Overrides of an input that carries a pose.");
  archive(timeout_key(), input.timeout_s);
  archive(speed_key("max_speed_m_per_s", "Largest speed of the set-point."), input.max_speed);
  archive(speed_key("max_angular_speed_rad_per_s", "Largest angular speed of the set-point."),
          input.max_angular_speed);
}

void visit(Archive& archive, JointsInput& input) {
  archive.about("Input (joints)", "Overrides of an input that carries joint positions.");
  archive(timeout_key(), input.timeout_s);
  archive(speed_key("max_speed_rad_per_s", "Largest speed of the set-point."), input.max_speed);
}

void visit(Archive& archive, OtherInput& input) {
  archive.about("Input (twist, wrench, scalar)", "Overrides of any other input.");
  archive(timeout_key(), input.timeout_s);
  archive(speed_key("max_rate_per_s", "Largest change of each number, in its unit per second."),
          input.max_speed);
}

void visit(Archive& archive, InstanceConfig& config, SceneReader& reader) {
  archive.about(
      "Controllet",
      "One instance of a control law, bound to its arms. Its types, parameters and inputs are listed at "
      "the end of this page.");
  archive(Key("name", "Unique name, used by switches and references.").identifier().required(), config.name);
  archive(Key("type", "Control law.").like(type_names(reader.registry)).required(), config.type);
  const auto arms = archive.names(
      Key("arms", "Names of the arms that it owns, in the order of its type: `left`, or `[left, right]`.")
          .required());
  const auto observed = archive.names(
      Key("observes", "Names of arms that it reads and does not own, such as the leader of a follower."));
  const auto features = archive.names(
      Key("features", "Features that are on from the start.").like(feature_names(reader.registry)));
  const auto parameters = archive.open(
      Key("parameters",
          "Values of parameters, by name. A single number may replace a list of equal ones. Parameters of "
          "features: `joint_limits: {range_rad: 0.1}` or `joint_limits.range_rad: 0.1`. `preset` selects "
          "named values of the type, or of the feature; parameters given with it take precedence."));
  Key inputs(
      "inputs",
      "Overrides of inputs, by name: `pose: {max_speed_m_per_s: 0.2}`. Default: the values of the type.");
  if (!archive.reading()) {
    inputs.parts = {Archive::describe<PoseInput>(), Archive::describe<JointsInput>(),
                    Archive::describe<OtherInput>()};
  }
  const auto overrides = archive.open(inputs);
  if (!archive.reading()) return;
  auto& places = reader.scene.controllet_places;
  if (const auto it = places.find(config.name); it != places.end()) {
    archive.at("name").refuse("two controllets have this name, the first in line " +
                              std::to_string(it->second.line));
  }
  const ControlletDescriptor& descriptor = find_type(archive, config.type, reader).descriptor;
  check_arms(archive, arms, descriptor, reader, config);
  check_observed(archive, observed, descriptor, reader, config);
  check_features(features, reader, config);
  replace_hold(archive, config, reader);
  if (parameters) {
    read_parameters(*parameters, reader, config);
    note_options(*parameters, config, reader.scene);
  }
  if (overrides) read_inputs(*overrides, descriptor, reader.scene, config);
  places[config.name] = archive.self().place();
}

// A follower that touches its leader may keep pushing it.
void note_near_leaders(Scene& scene) {
  constexpr double kBothReach = 2;  // two Franka arms with hands and tools [m]
  for (const auto& config : scene.controllets) {
    const auto& features = config.features;
    if (std::find(features.begin(), features.end(), "collision_avoidance") != features.end()) continue;
    for (const ArmIndex leader : config.observes) {
      for (const ArmIndex own : config.arms) {
        const Vector3 between = scene.arms[own].X_WB.position - scene.arms[leader].X_WB.position;
        if (between.norm() > kBothReach) continue;
        scene.near_leaders.push_back("'" + config.name + "': arm '" + scene.arms[own].name +
                                     "' may reach its leader '" + scene.arms[leader].name +
                                     "' and keep pushing it; keep their workspaces apart, or add the feature "
                                     "collision_avoidance");
      }
    }
  }
}

void read_active(Archive& archive, SceneReader& reader) {
  const auto names = archive.names(
      Key("active",
          "Controllets that run from the first cycle on. At most one per arm; the other arms are held."));
  for (const InstanceConfig* owner : read_owners(reader, names)) reader.scene.active.push_back(owner->name);
}

}  // namespace multipanda
