#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>

#include "common/own_files.hpp"
#include "common/text.hpp"
#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"
#include "scene/rewrite.hpp"
#include "yaml_reader/archive.hpp"

namespace multipanda {

std::vector<Override> read_overrides(Archive& archive, const char* doc) {
  std::vector<Override> list;
  if (const auto node = archive.open(Key("set", doc))) {
    for (const auto& [key, value] : node->pairs())
      list.push_back({.key = key, .value = yaml_text(value.yaml()), .place = value.place()});
  }
  return list;
}

namespace {

namespace fs = std::filesystem;

// Scalars become numbers, booleans or strings, by their syntax; a scalar in quotes is a string.
nlohmann::ordered_json json_of(const YAML::Node& node) {
  if (node.IsScalar()) {
    auto value = nlohmann::ordered_json::parse(node.Scalar(), nullptr, false);
    const bool plain = node.Tag() != "!" && (value.is_number() || value.is_boolean());
    return plain ? value : nlohmann::ordered_json(node.Scalar());
  }
  nlohmann::ordered_json out = node.IsSequence() ? nlohmann::ordered_json::array() : nlohmann::ordered_json();
  for (const auto& item : node) {
    if (node.IsSequence())
      out.push_back(json_of(item));
    else
      out[item.first.Scalar()] = json_of(item.second);
  }
  return out;
}

struct ExperimentAxis {
  std::string name;
  std::vector<ExperimentVariant> choices;
};

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

std::vector<ExperimentVariant> all_variants(const Archive& archive, const std::vector<ExperimentAxis>& axes,
                                            const std::vector<ExperimentVariant>& single) {
  std::vector<ExperimentVariant> variants;
  for (const auto& axis : axes) {
    if (axis.choices.empty()) archive.at("axes").refuse("axis '" + axis.name + "' needs at least one choice");
    std::vector<ExperimentVariant> product;
    for (const auto& a : variants) {
      for (const auto& b : axis.choices) product.push_back(combined(a, b));
    }
    variants = variants.empty() ? axis.choices : std::move(product);
  }
  variants.insert(variants.end(), single.begin(), single.end());
  if (variants.empty())
    variants.push_back({.name = "plain", .label = "as in the scene", .tags = {"plain"}, .set = {}});
  std::set<std::string> seen;
  for (const auto& variant : variants) {
    if (!seen.insert(variant.name).second)
      archive.self().refuse("two variants have the name " + in_quotes(variant.name) + "; names must differ");
  }
  return variants;
}

// A bound of a figure: one number for all plants, or one per plant.
std::map<std::string, double> read_bounds(Archive& archive, const char* name, const Experiment& experiment) {
  std::map<std::string, double> bounds;
  const auto node = archive.open(Key(name, "A number, or one per plant."));
  if (!node) return bounds;
  // Kinds without plants have a world of their own.
  const std::vector<std::string> plants =
      experiment.plants.empty() ? std::vector<std::string>{""} : experiment.plants;
  Key number(name, "");
  number.kind = Key::Kind::number;
  if (!node->is_map()) {
    for (const auto& plant : plants) bounds[plant] = node->number(number);
    return bounds;
  }
  for (const auto& [plant, value] : node->pairs()) {
    if (std::find(plants.begin(), plants.end(), plant) == plants.end())
      value.refuse("there is no plant " + in_quotes(plant) + name_hint(plant, plants, "there are none"));
    bounds[plant] = value.number(number);
  }
  return bounds;
}

void visit_limit(Archive& archive, ExperimentLimit& limit, const Experiment& experiment) {
  archive.about("Limit", "Limits of a figure, checked in the worst repeat.");
  archive(Key("metric", "Name of the figure.").required(), limit.metric);
  limit.at_most = read_bounds(archive, "at_most", experiment);
  limit.at_least = read_bounds(archive, "at_least", experiment);
  const auto names =
      archive.names(Key("variants", "Names of variants or choices. Default: all except the reported ones."));
  if (!archive.reading()) return;
  const auto& metrics = find_kind(experiment.kind)->metrics;
  if (std::find(metrics.begin(), metrics.end(), limit.metric) == metrics.end()) {
    archive.at("metric").refuse("there is no metric " + in_quotes(limit.metric) +
                                name_hint(limit.metric, metrics, "there are none"));
  }
  if (limit.at_most.empty() && limit.at_least.empty())
    archive.self().refuse("a limit needs the key 'at_most' or 'at_least'");
  std::vector<std::string> known;
  for (const auto& variant : experiment.variants)
    known.insert(known.end(), variant.tags.begin(), variant.tags.end());
  for (const auto& name : names) {
    limit.variants.push_back(name.yaml().Scalar());
    if (!known.empty() && std::find(known.begin(), known.end(), limit.variants.back()) == known.end()) {
      name.refuse("there is no variant or choice " + in_quotes(limit.variants.back()) +
                  name_hint(limit.variants.back(), known, "there are none"));
    }
  }
}

Key name_key(const char* name, const char* doc) { return Key(name, doc).identifier().required(); }

void visit_direction(Archive& archive) {
  Vector3 direction = Vector3::Zero();
  archive(Key("direction", "Unit vector in the world along which the arm pushes.").within(-1, 1).required(),
          direction);
}

void visit_window(Archive& archive) {
  archive.about("Window", "The time over which the figures are computed.");
  std::string after = "start";
  double offset = 0, duration = 10;
  archive(
      Key("after",
          "Begins at the start, after every arm in `force` has made contact, or with the first motion of the "
          "timeline.")
          .one_of({"start", "contact", "motion"}),
      after);
  archive(Key("offset_s", "Additional delay of the start.").within(0, 3600), offset);
  archive(Key("duration_s", "Length.").within(0.01, 3600), duration);
}

void visit_force(Archive& archive) {
  archive.about("Force", "A controlled force.");
  std::string arm, instance, desired = "force_desired_n";
  std::optional<double> desired_n;
  archive(name_key("arm", "Arm that exerts it."), arm);
  visit_direction(archive);
  archive(name_key("instance", "Controllet whose outputs are evaluated."), instance);
  archive(Key("desired", "Name of its output with the desired force."), desired);
  archive(Key("desired_n", "Desired force, if the controllet has no such output."), desired_n);
}

// An input of a controllet whose set-point counts.
void visit_set_point(Archive& archive) {
  std::string instance, input = "pose";
  archive(name_key("instance", "Controllet that has the set-point."), instance);
  archive(Key("input", "Its input."), input);
}

void visit_path(Archive& archive) {
  archive.about("Path", "A set-point that the end effector follows.");
  std::string arm, plane = "xyz";
  archive(name_key("arm", "Name of the arm."), arm);
  visit_set_point(archive);
  archive(Key("plane", "Part of the error that is evaluated.").one_of({"xy", "xyz"}), plane);
}

void visit_grasp(Archive& archive) {
  archive.about("Grasp", "An object that arms hold; it follows the set-point of a controllet.");
  std::string name;
  archive(name_key("name", "Name of the object."), name);
  visit_set_point(archive);
}

void visit_loss(Archive& archive) {
  archive.about("Loss", "A surface that is removed.");
  std::string arm;
  double at = 0;
  archive(name_key("arm", "Arm that loses contact."), arm);
  archive(Key("at_s", "Time of the removal.").at_least(0).required(), at);
  visit_direction(archive);
}

void visit_measure(Archive& archive) {
  archive.about("Measure", "Quantities measured in addition to the figures of every run.");
  archive.part(Key("window", "The evaluated time window."), visit_window);
  archive.items(Key("force", "Controlled forces."), visit_force);
  archive.part(Key("path", "A set-point that is followed."), visit_path);
  archive.part(Key("grasp", "An object that is held."), visit_grasp);
  archive.part(Key("loss", "A surface that is removed."), visit_loss);
}

nlohmann::ordered_json default_json(const Key& key) {
  if (key.kind == Key::Kind::number) return std::stod(key.fallback);
  return key.fallback;
}

// The contents of a section as JSON, defaults included. Its keys were checked before.
nlohmann::ordered_json checked_json(const Node& node, const Section& section) {
  const auto pairs = node.pairs();
  nlohmann::ordered_json out = nlohmann::ordered_json::object();
  for (const auto& key : section.keys) {
    const auto pair =
        std::find_if(pairs.begin(), pairs.end(), [&](const auto& p) { return p.first == key.name; });
    if (pair == pairs.end()) {
      if (!key.fallback.empty()) out[key.name] = default_json(key);
      continue;
    }
    const Node& value = pair->second;
    auto& json = out[key.name];
    if (key.kind == Key::Kind::number) {
      json = value.number(key);
    } else if (key.kind == Key::Kind::numbers) {
      json = value.numbers(key);
    } else if (key.kind == Key::Kind::section) {
      json = checked_json(value, *key.parts[0]);
    } else if (key.kind == Key::Kind::sections) {
      json = nlohmann::ordered_json::array();
      for (const auto& item : value.items()) json.push_back(checked_json(item, *key.parts[0]));
    } else {
      json = value.text(key);
    }
  }
  return out;
}

void check_task(const Archive& archive, Experiment& experiment) {
  if (!archive.has("scene"))
    archive.self().refuse("the key 'scene' is missing; expected the path of a scene file");
  experiment.scene = archive.at("scene").resolved(experiment.scene);
  if (!fs::is_regular_file(experiment.scene))
    archive.at("scene").refuse("there is no file " + experiment.scene);
  if (experiment.plants.empty()) experiment.plants = {"ideal", "realistic"};
}

}  // namespace

void visit(Archive& archive, ExperimentVariant& variant) {
  archive.about("Variant", "One way to run the experiment.");
  archive(name_key("name", "Unique name; used in file names and limits."), variant.name);
  variant.label = variant.name;
  archive(Key("label", "Label on pages. Default: the name."), variant.label);
  variant.tags = {variant.name};
  variant.set = read_overrides(archive, "Values put into the scene, by key path.");
  archive(Key("reported", "`true`: shown, but only limits that name it apply."), variant.reported);
}

void visit(Archive& archive, ExperimentAxis& axis) {
  archive.about("Axis", "Choices of one kind; every combination of all axes is a variant.");
  archive(name_key("name", "What is chosen."), axis.name);
  archive.list(Key("choices", "The choices."), axis.choices);
}

void visit(Archive& archive, Variation& variation) {
  archive.about("Variation", "Varies a number of the scene, or each number of a list, in every repeat.");
  archive(Key("key", "Key path.").required(), variation.key);
  archive(Key("by", "Bound of the uniform distribution, in both directions.").at_least(0).required(),
          variation.by);
  if (archive.reading()) variation.place = archive.self().place();
}

void visit(Archive& archive, PublishedFigure& published) {
  archive.about("Published", "A figure published by others for the same task.");
  archive(Key("metric", "Corresponding figure of this project, if there is one."), published.metric);
  archive(Key("value", "Value in the unit of the metric.").no_default(), published.value);
  archive(Key("text", "What it is and where it is published.").required(), published.text);
}

void visit(Archive& archive, Experiment& experiment) {
  archive.about("Experiment", "The top level of the file.");
  experiment.kind = kTaskKind;
  archive(Key("kind", "Runner of the experiment.").like(kind_names()), experiment.kind);
  archive(Key("title", "Title.").required(), experiment.title);
  archive(Key("description", "Description for readers."), experiment.description);
  archive(Key("seed", "Seed of the variation and of the noise of the scene.").within(0, 1e9),
          experiment.seed);
  archive(Key("repeats", "Number of repeats of every variant on every plant.").within(1, 1000),
          experiment.repeats);
  archive.list(Key("published", "Figures of others."), experiment.published);
  archive(Key("show", "Figures shown as bars although they have no limit."), experiment.show);
  archive(Key("scene", "Scene file, relative to this file."), experiment.scene);
  experiment.set = read_overrides(archive, "Values put into the scene of every variant, by key path.");
  archive(Key("plants", "Named sets of simulation fidelity. Default: both."), experiment.plants);
  std::vector<ExperimentVariant> single;
  std::vector<ExperimentAxis> axes;
  archive.list(Key("variants", "Single variants.").each("variant"), single);
  archive.list(Key("axes", "Choices to be combined.").each("axis"), axes);
  archive.list(Key("vary", "What differs from repeat to repeat."), experiment.vary);
  archive.part(Key("measure", "What is measured."), visit_measure);
  const auto settings = archive.open(Key("settings", "Settings of runners of other kinds."));
  if (archive.reading()) {
    if (find_kind(experiment.kind) == nullptr) {
      archive.at("kind").refuse("there is no kind " + in_quotes(experiment.kind) +
                                name_hint(experiment.kind, kind_names(), "there are none"));
    }
    if (experiment.kind == kTaskKind) {
      check_task(archive, experiment);
      experiment.variants = all_variants(archive, axes, single);
    }
    if (archive.has("measure"))
      experiment.measure = checked_json(archive.at("measure"), *Archive::described(visit_measure, true));
    if (settings) experiment.settings = json_of(settings->yaml());
  }
  archive.items(Key("limits", "Limits that the results must meet.").each("limit"), [&](Archive& inner) {
    ExperimentLimit limit;
    visit_limit(inner, limit, experiment);
    if (inner.reading()) experiment.limits.push_back(std::move(limit));
  });
}

namespace {

std::string found_experiment(const std::string& name) {
  if (name.find('/') != std::string::npos || name.ends_with(".yaml")) {
    if (fs::is_directory(name))
      throw ConfigError({name, 0}, "this is a folder; expected an experiment file inside it");
    if (!fs::is_regular_file(name)) throw ConfigError({name, 0}, "there is no such file");
    return name;
  }
  const fs::path file = fs::path(experiments_folder()) / (name + ".yaml");
  if (!fs::is_regular_file(file)) {
    throw ConfigError({name, 0}, "there is no experiment of this name" +
                                     name_hint(name, available_experiments(), "there are no experiments"));
  }
  return file.string();
}

}  // namespace

std::string experiments_folder() { return (share_folder() / "experiments").string(); }

std::vector<std::string> available_experiments() {
  std::vector<std::string> names;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(experiments_folder(), missing)) {
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

Experiment parse_experiment(const std::string& text, const std::string& file_name) {
  Experiment experiment;
  experiment.path = file_name;
  experiment.name = fs::path(file_name).stem().string();
  Archive::read(Node::parse(text, file_name), experiment);
  return experiment;
}

Experiment load_experiment(const std::string& name_or_path) {
  const std::string path = found_experiment(name_or_path);
  return parse_experiment(read_text(path), path);
}

}  // namespace multipanda
