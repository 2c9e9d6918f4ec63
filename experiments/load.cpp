#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"
#include "experiments/schema.hpp"
#include "experiments/yaml_tree.hpp"
#include "scene/mapping.hpp"
#include "scene/names.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

std::vector<Override> read_overrides(const Mapping& mapping) {
  std::vector<Override> list;
  if (!mapping.has("set")) return list;
  for (const auto& [key, value] : pairs_of(mapping.entry("set"))) {
    list.push_back({.key = key, .value = yaml_text(value.node()), .place = value.place()});
  }
  return list;
}

ExperimentVariant read_variant(const Mapping& mapping) {
  ExperimentVariant variant;
  variant.name = mapping.text("name");
  variant.label = mapping.has("label") ? mapping.text("label") : variant.name;
  variant.tags = {variant.name};
  variant.set = read_overrides(mapping);
  variant.reported = mapping.boolean("reported");
  return variant;
}

ExperimentVariant combined(const ExperimentVariant& a, const ExperimentVariant& b) {
  ExperimentVariant both = a;
  both.name += "_" + b.name;
  both.label += ", " + b.label;
  both.tags.insert(both.tags.end(), b.tags.begin(), b.tags.end());
  both.tags.push_back(both.name);
  both.set.insert(both.set.end(), b.set.begin(), b.set.end());
  both.reported = a.reported || b.reported;
  return both;
}

std::vector<ExperimentVariant> read_variants(const Mapping& root) {
  std::vector<ExperimentVariant> variants;
  for (const auto& item : root.items("axes")) {
    const Mapping axis(item.as("axis"), experiment_schema::axis());
    std::vector<ExperimentVariant> choices;
    for (const auto& choice : axis.items("choices")) {
      choices.push_back(read_variant(Mapping(choice, experiment_schema::variant())));
    }
    if (choices.empty()) item.refuse("an axis needs at least one choice");
    if (variants.empty()) {
      variants = choices;
      continue;
    }
    std::vector<ExperimentVariant> product;
    for (const auto& a : variants) {
      for (const auto& b : choices) product.push_back(combined(a, b));
    }
    variants = std::move(product);
  }
  for (const auto& item : root.items("variants")) {
    variants.push_back(read_variant(Mapping(item.as("variant"), experiment_schema::variant())));
  }
  if (variants.empty())
    variants.push_back({.name = "plain", .label = "as in the scene", .tags = {"plain"}, .set = {}});
  std::set<std::string> seen;
  for (const auto& variant : variants) {
    if (!seen.insert(variant.name).second)
      root.self().refuse("two variants have the name " + in_quotes(variant.name) + "; names must differ");
  }
  return variants;
}

std::map<std::string, double> read_bounds(const Mapping& limit, const char* key,
                                          const std::vector<std::string>& plants) {
  static const Field number{.key = "limit", .kind = FieldKind::number, .doc = ""};
  std::map<std::string, double> bounds;
  if (!limit.has(key)) return bounds;
  const Entry entry = limit.entry(key);
  if (!entry.node().IsMap()) {
    const double value = entry.number(number);
    for (const auto& plant : plants) bounds[plant] = value;
    return bounds;
  }
  for (const auto& [plant, value] : pairs_of(entry)) {
    if (std::find(plants.begin(), plants.end(), plant) == plants.end())
      value.refuse("there is no plant " + in_quotes(plant) + name_hint(plant, plants, "there are none"));
    bounds[plant] = value.number(number);
  }
  return bounds;
}

std::vector<ExperimentLimit> read_limits(const Mapping& root, const Experiment& experiment) {
  std::vector<std::string> known;
  for (const auto& variant : experiment.variants)
    known.insert(known.end(), variant.tags.begin(), variant.tags.end());
  std::vector<ExperimentLimit> limits;
  // Kinds without plants have one world of their own.
  const std::vector<std::string> plants =
      experiment.plants.empty() ? std::vector<std::string>{""} : experiment.plants;
  for (const auto& item : root.items("limits")) {
    const Mapping mapping(item.as("limit"), experiment_schema::limit());
    ExperimentLimit limit{.metric = mapping.text("metric"),
                          .at_most = read_bounds(mapping, "at_most", plants),
                          .at_least = read_bounds(mapping, "at_least", plants),
                          .variants = {}};
    if (limit.at_most.empty() && limit.at_least.empty())
      item.refuse("a limit needs the key 'at_most' or 'at_least'");
    for (const auto& name : mapping.text_items("variants")) {
      limit.variants.push_back(name.node().Scalar());
      if (!known.empty() && std::find(known.begin(), known.end(), limit.variants.back()) == known.end())
        name.refuse("there is no variant or choice " + in_quotes(limit.variants.back()) +
                    name_hint(limit.variants.back(), known, "there are none"));
    }
    limits.push_back(std::move(limit));
  }
  return limits;
}

// The part of the file as JSON, with every key checked and every default filled in.
nlohmann::ordered_json checked(const Mapping& mapping, const Section& section) {
  nlohmann::ordered_json out = nlohmann::ordered_json::object();
  for (const auto& field : section.fields) {
    if (!mapping.has(field.key) && field.fallback.empty()) continue;
    switch (field.kind) {
      case FieldKind::number:
        out[field.key] = mapping.number(field.key);
        break;
      case FieldKind::numbers:
        out[field.key] = mapping.numbers(field.key);
        break;
      case FieldKind::section:
        out[field.key] = checked(mapping.section(field.key), *field.section);
        break;
      case FieldKind::sections:
        out[field.key] = nlohmann::ordered_json::array();
        for (const auto& item : mapping.items(field.key))
          out[field.key].push_back(checked(Mapping(item, *field.section), *field.section));
        break;
      default:
        out[field.key] = mapping.text(field.key);
    }
  }
  return out;
}

void read_task(const Mapping& root, Experiment& experiment) {
  if (!root.has("scene")) root.self().refuse("the key 'scene' is missing; expected the path of a scene file");
  const fs::path scene = root.text("scene");
  experiment.scene = scene.is_absolute()
                         ? scene.string()
                         : (fs::path(experiment.path).parent_path() / scene).lexically_normal().string();
  if (!fs::is_regular_file(experiment.scene))
    root.entry("scene").refuse("there is no file " + experiment.scene);
  experiment.set = read_overrides(root);
  for (const auto& plant : root.text_items("plants")) experiment.plants.push_back(plant.node().Scalar());
  if (experiment.plants.empty()) experiment.plants = {"ideal", "realistic"};
  experiment.variants = read_variants(root);
  for (const auto& item : root.items("vary")) {
    const Mapping mapping(item.as("vary"), experiment_schema::variation());
    experiment.vary.push_back(
        {.key = mapping.text("key"), .by = mapping.number("by"), .place = item.place()});
  }
  if (root.has("measure"))
    experiment.measure = checked(root.section("measure"), experiment_schema::measure());
}

Experiment read_experiment(const Mapping& root) {
  Experiment experiment;
  experiment.path = root.self().file().name;
  experiment.name = fs::path(experiment.path).stem().string();
  experiment.kind = root.text("kind");
  if (find_kind(experiment.kind) == nullptr) {
    root.entry("kind").refuse("there is no kind " + in_quotes(experiment.kind) +
                              name_hint(experiment.kind, kind_names(), "there are none"));
  }
  experiment.title = root.text("title");
  if (root.has("description")) experiment.description = root.text("description");
  experiment.seed = static_cast<std::uint64_t>(root.number("seed"));
  experiment.repeats = static_cast<std::size_t>(root.number("repeats"));
  for (const auto& item : root.items("published")) {
    const Mapping mapping(item.as("published"), experiment_schema::published());
    experiment.published.push_back({.metric = mapping.has("metric") ? mapping.text("metric") : "",
                                    .value = mapping.has("value") ? mapping.number("value") : 0,
                                    .text = mapping.text("text")});
  }
  for (const auto& name : root.text_items("show")) experiment.show.push_back(name.node().Scalar());
  if (experiment.kind == kTaskKind) read_task(root, experiment);
  if (root.has("settings")) experiment.settings = yaml_json(root.entry("settings").node());
  experiment.limits = read_limits(root, experiment);
  return experiment;
}

std::string found_experiment(const std::string& name) {
  if (name.find('/') != std::string::npos || name.ends_with(".yaml")) {
    if (!fs::is_regular_file(name)) throw SceneError({name, 0}, "there is no such file");
    return name;
  }
  const fs::path file = fs::path(experiments_folder()) / (name + ".yaml");
  if (!fs::is_regular_file(file)) {
    throw SceneError({name, 0}, "there is no experiment of this name" +
                                    name_hint(name, available_experiments(), "there are no experiments"));
  }
  return file.string();
}

}  // namespace

std::string experiments_folder() {
  const char* share = std::getenv("MULTIPANDA_SHARE");
  const fs::path root = share != nullptr && *share != '\0' ? share : MULTIPANDA_DEFAULT_SHARE;
  return (root / "experiments").string();
}

std::vector<std::string> available_experiments() {
  std::vector<std::string> names;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(experiments_folder(), missing)) {
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

Experiment parse_experiment(const std::string& text, const std::string& file_name) try {
  const SceneFile file{file_name, fs::path(file_name).parent_path().string()};
  const YAML::Node node = YAML::Load(text);
  return read_experiment(Mapping(Entry(file, node, 1, ""), experiment_schema::experiment()));
} catch (const YAML::Exception& error) {
  throw SceneError({file_name, error.mark.line + 1}, "not readable as YAML: " + error.msg);
}

Experiment load_experiment(const std::string& name_or_path) {
  const std::string path = found_experiment(name_or_path);
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw SceneError({path, 0}, "cannot be read");
  return parse_experiment(text.str(), path);
}

}  // namespace multipanda
