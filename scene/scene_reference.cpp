#include "scene/scene_reference.hpp"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "config_file/json_schema.hpp"
#include "config_file/reference_page.hpp"
#include "config_file/text.hpp"
#include "scene/load_parts.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

std::shared_ptr<const Section> scene_section(const Registry& registry) {
  SceneReader reader(registry);
  return Archive::described([&](Archive& archive) { visit(archive, reader); }, true);
}

std::string size_text(std::size_t size) {
  return size == ParameterSpec::kPerJoint ? "one per joint"
         : size == 1                      ? ""
                                          : std::to_string(size) + " numbers";
}

std::string default_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return spec.choices[static_cast<std::size_t>(spec.initial.at(0))];
  if (spec.initial.size() == 1) return number_text(spec.initial[0]);
  // Defaults per joint are written for the largest arm; the first eight are shown.
  constexpr std::size_t kShown = 8;
  if (spec.initial.size() <= kShown) return list_text(spec.initial);
  std::string text = list_text({spec.initial.begin(), spec.initial.begin() + kShown});
  return text.replace(text.size() - 1, 1, ", ...]");
}

std::string range_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return joined(spec.choices, ", ");
  std::string text = bounds_text(spec.min, spec.max);
  if (!spec.unit.empty()) text += " " + spec.unit;
  const std::string size = size_text(spec.size);
  return size.empty() ? text : size + ", each " + text;
}

void write_descriptor(const ControlletDescriptor& descriptor, bool controllet, std::string& out) {
  out += "\n### " + descriptor.type + "\n\n" + descriptor.doc;
  if (controllet)
    out += " Owns " + std::to_string(descriptor.arms) + (descriptor.arms == 1 ? " arm." : " arms.");
  if (descriptor.observes > 0) out += " Observes " + std::to_string(descriptor.observes) + ".";
  out += "\n";
  if (!descriptor.inputs.empty()) {
    out +=
        "\n| input | carries | frame | of arm | lost after | fastest | meaning "
        "|\n|---|---|---|---|---|---|---|\n";
    for (const auto& input : descriptor.inputs) {
      const bool pose = input.quantity == Quantity::pose, joints = input.quantity == Quantity::joints;
      std::string speed = number_text(input.max_speed) + (pose ? " m/s" : joints ? " rad/s" : " 1/s");
      if (pose) speed += ", " + number_text(input.max_angular_speed) + " rad/s";
      out += "| " + code_text(input.name) + " | " + std::string(to_string(input.quantity)) + " | " +
             table_cell(joints ? "" : input.frame) + " | " + std::to_string(input.arm + 1) + " | " +
             number_text(input.timeout_s) + " s | " + speed + " | " + table_cell(input.doc) + " |\n";
    }
  }
  if (!descriptor.parameters.empty()) {
    out += "\n| parameter | value | default | meaning |\n|---|---|---|---|\n";
    for (const auto& spec : descriptor.parameters) {
      out += "| " + code_text(spec.name) + " | " + table_cell(range_text(spec)) + " | " +
             code_text(default_text(spec)) + " | " + table_cell(spec.doc) + " |\n";
    }
  }
  if (!descriptor.presets.empty()) out += "\n| preset | meaning | values |\n|---|---|---|\n";
  for (const Preset& preset : descriptor.presets) {
    std::string values;
    for (const auto& value : preset.values) {
      const auto spec = std::ranges::find(descriptor.parameters, value.parameter, &ParameterSpec::name);
      const bool choice = spec != descriptor.parameters.end() && !spec->choices.empty();
      if (!values.empty()) values += ", ";
      values += code_text(value.parameter + ": " +
                          (choice ? spec->choices[static_cast<std::size_t>(value.values[0])]
                           : value.values.size() > 1 ? list_text(value.values)
                                                     : number_text(value.values[0])));
    }
    out +=
        "| " + code_text(preset.name) + " | " + table_cell(preset.doc) + " | " + table_cell(values) + " |\n";
  }
}

void add_presets(const ControlletDescriptor& descriptor, nlohmann::ordered_json& properties) {
  if (descriptor.presets.empty()) return;
  nlohmann::ordered_json names = nlohmann::ordered_json::array();
  for (const Preset& preset : descriptor.presets) names.push_back(preset.name);
  properties["preset"] = {{"enum", names}, {"description", "Named values; parameters beside it win."}};
}

nlohmann::ordered_json parameter_schema(const ParameterSpec& spec) {
  nlohmann::ordered_json value{{"type", "number"}, {"minimum", spec.min}, {"maximum", spec.max}};
  if (spec.unit == "rad" || spec.choices == std::vector<std::string>{"false", "true"})
    value = {{"type", {"number", "string", "boolean"}}};
  else if (!spec.choices.empty())
    value = {{"enum", spec.choices}};
  nlohmann::ordered_json schema;
  if (spec.size == 1) {
    schema = value;
  } else {
    schema["anyOf"] = {value, {{"type", "array"}, {"items", value}}};
  }
  schema["description"] = spec.doc + (spec.unit.empty() ? "" : " [" + spec.unit + "]");
  return schema;
}

}  // namespace

std::string scene_reference_markdown(const Registry& registry) {
  std::string out =
      "# Scene reference\n\n"
      "Generated by the build target `scene_reference` from the code that reads scenes; do not edit. "
      "Templates are "
      "in `config/scenes/`.\n"
      "Editors with a YAML language server complete and check keys by `config/schemas/scene.json`, which the "
      "first "
      "line of the templates names.\n\n"
      "Keys carry their units; everything is SI. Angles are in radians: a value beyond 2 pi is refused as "
      "degrees. "
      "An error is reported\n"
      "before anything moves, with file, line and what was expected.\n";
  out += reference_tables(*scene_section(registry));
  out += "\n## Controllet types\n";
  for (const auto& type : registry.controllets()) write_descriptor(type.descriptor, true, out);
  out += "\n## Features\n\nA feature adds its torque to that of the controllet that it is switched on for.\n";
  for (const auto& type : registry.features()) write_descriptor(type.descriptor, false, out);
  return out;
}

std::string scene_json_schema(const Registry& registry) {
  nlohmann::ordered_json schema = json_schema(*scene_section(registry), "multipanda scene");
  nlohmann::ordered_json features = nlohmann::ordered_json::object();
  for (const auto& feature : registry.features()) {
    for (const auto& spec : feature.descriptor.parameters) {
      features[feature.descriptor.type]["type"] = "object";
      features[feature.descriptor.type]["properties"][spec.name] = parameter_schema(spec);
      features[feature.descriptor.type + "." + spec.name] = parameter_schema(spec);
    }
    if (!feature.descriptor.presets.empty())
      add_presets(feature.descriptor, features[feature.descriptor.type]["properties"]);
  }
  auto& rules = schema["definitions"]["Controllet"]["allOf"];
  for (const auto& type : registry.controllets()) {
    nlohmann::ordered_json parameters = features;
    for (const auto& spec : type.descriptor.parameters) parameters[spec.name] = parameter_schema(spec);
    add_presets(type.descriptor, parameters);
    rules.push_back(
        {{"if", {{"properties", {{"type", {{"const", type.descriptor.type}}}}}}},
         {"then",
          {{"properties",
            {{"parameters",
              {{"type", "object"}, {"properties", parameters}, {"additionalProperties", false}}}}}}}});
  }
  return schema.dump(1, '\t') + "\n";
}

}  // namespace multipanda
