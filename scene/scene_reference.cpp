#include "scene/scene_reference.hpp"

#include <cctype>

#include "scene/fields.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

std::string cell(std::string text) {
  std::string escaped;
  for (const char c : text) escaped += c == '|' ? "\\|" : std::string(1, c);
  return escaped.empty() ? " " : escaped;
}

std::string anchor(const std::string& heading) {
  std::string link = "#";
  for (const char c : heading) {
    if (c == ' ') link += '-';
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      link += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return link;
}

std::string code(const std::string& text) { return text.empty() ? "" : "`" + text + "`"; }

std::string value_text(const Field& field) {
  const std::string link =
      field.section == nullptr ? "" : "[" + field.section->name + "](" + anchor(field.section->name) + ")";
  if (field.kind == FieldKind::section) return link;
  if (field.kind == FieldKind::sections) return "list of " + link;
  if (field.kind == FieldKind::open) return "see there";
  return expectation(field);
}

void write_section(const Section& section, std::string& out) {
  out += "\n## " + section.name + "\n\n";
  if (!section.doc.empty()) out += section.doc + "\n\n";
  out += "| key | value | default | meaning |\n|---|---|---|---|\n";
  for (const auto& field : section.fields) {
    const bool empty_section = field.fallback == "{}" || field.fallback == "''";
    const std::string absent = field.required ? "**required**" : empty_section ? "" : code(field.fallback);
    out += "| " + code(field.key) + " | " + cell(value_text(field)) + " | " + cell(absent) + " | " +
           cell(field.doc) + " |\n";
  }
}

std::string size_text(std::size_t size) {
  return size == ParameterSpec::kPerJoint ? "one per joint"
         : size == 1                      ? ""
                                          : std::to_string(size) + " numbers";
}

std::string default_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return spec.choices[static_cast<std::size_t>(spec.initial.at(0))];
  std::string text;
  // Defaults per joint are written for the largest arm; the first eight say enough.
  constexpr std::size_t kShown = 8;
  for (std::size_t i = 0; i < spec.initial.size() && i < kShown; ++i)
    text += (i == 0 ? "" : ", ") + number_text(spec.initial[i]);
  if (spec.initial.size() > kShown) text += ", ...";
  return spec.initial.size() == 1 ? text : "[" + text + "]";
}

std::string range_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return joined(spec.choices, ", ");
  std::string text = bounds_text(spec.min, spec.max);
  if (!spec.unit.empty()) text += " " + spec.unit;
  const std::string size = size_text(spec.size);
  return size.empty() ? text : size + ", each " + text;
}

void write_statement(const Statement& statement, bool controllet, std::string& out) {
  out += "\n### " + statement.type + "\n\n" + statement.doc;
  if (controllet)
    out += " Owns " + std::to_string(statement.arms) + (statement.arms == 1 ? " arm." : " arms.");
  out += "\n";
  if (!statement.inputs.empty()) {
    out +=
        "\n| input | carries | frame | of arm | lost after | fastest | meaning "
        "|\n|---|---|---|---|---|---|---|\n";
    for (const auto& input : statement.inputs) {
      const bool pose = input.quantity == Quantity::pose, joints = input.quantity == Quantity::joints;
      std::string speed = number_text(input.max_speed) + (pose ? " m/s" : joints ? " rad/s" : " 1/s");
      if (pose) speed += ", " + number_text(input.max_angular_speed) + " rad/s";
      out += "| " + code(input.name) + " | " + std::string(to_string(input.quantity)) + " | " +
             cell(joints ? "" : input.frame) + " | " + std::to_string(input.arm + 1) + " | " +
             number_text(input.timeout_s) + " s | " + speed + " | " + cell(input.doc) + " |\n";
    }
  }
  if (!statement.parameters.empty()) {
    out += "\n| parameter | value | default | meaning |\n|---|---|---|---|\n";
    for (const auto& spec : statement.parameters) {
      out += "| " + code(spec.name) + " | " + cell(range_text(spec)) + " | " + code(default_text(spec)) +
             " | " + cell(spec.doc) + " |\n";
    }
  }
}

}  // namespace

std::string scene_reference_markdown(const Registry& registry) {
  std::string out =
      "# Scene reference\n\n"
      "Written by `multipanda docs scene` from the tables that read scenes; do not edit. Templates to start "
      "from are in\n"
      "`config/scenes/`. Keys carry their units; everything is SI. Angles are radians: a value beyond 2 pi "
      "is refused as\n"
      "degrees. Whatever does not fit is refused before anything moves, with file, line and what was "
      "expected.\n";
  for (const Section* section : schema::all()) write_section(*section, out);
  out += "\n## Controllet types\n";
  for (const auto& type : registry.controllets()) write_statement(type.statement, true, out);
  out += "\n## Features\n\nA feature adds its torque to whatever controllet it is switched on for.\n";
  for (const auto& type : registry.features()) write_statement(type.statement, false, out);
  return out;
}

}  // namespace multipanda
