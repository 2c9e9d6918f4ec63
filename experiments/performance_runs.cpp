#include "experiments/performance_runs.hpp"

#include <algorithm>
#include <filesystem>

#include "common/text.hpp"
#include "experiments/task_runs.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A mapping of `settings`: every key must be known, every value of the right kind.
class Keys {
 public:
  Keys(const Experiment& experiment, const Json& map, std::string where, std::vector<std::string> known)
      : path_(experiment.path), map_(map), where_(std::move(where)) {
    if (!map.is_object()) refuse(": expected keys and values");
    for (const auto& [key, value] : map.items()) {
      if (std::find(known.begin(), known.end(), key) == known.end())
        refuse(": there is no key " + in_quotes(key) + name_hint(key, known, "there are none"));
    }
  }

  bool has(const char* key) const { return map_.contains(key); }
  const Json& at(const char* key) const {
    if (!has(key)) refuse(key, "this key is missing");
    return map_.at(key);
  }
  std::string text(const char* key) const {
    if (!at(key).is_string()) refuse(key, "expected a string");
    return at(key).get<std::string>();
  }
  void read(const char* key, std::string& value) const {
    if (has(key)) value = text(key);
  }
  void read(const char* key, double& value) const {
    if (!has(key)) return;
    if (!at(key).is_number() || at(key).get<double>() <= 0) refuse(key, "expected a number above 0");
    value = at(key).get<double>();
  }
  std::vector<std::string> texts(const char* key) const {
    std::vector<std::string> list;
    for (const auto& item : items(key)) {
      if (!item.is_string()) refuse(key, "expected names");
      list.push_back(item.get<std::string>());
    }
    return list;
  }
  const Json& items(const char* key) const {
    if (!at(key).is_array()) refuse(key, "expected a list");
    return at(key);
  }
  std::string file(const char* key) const {
    const fs::path given = text(key);
    const fs::path found = given.is_absolute() ? given : fs::path(path_).parent_path() / given;
    if (!fs::is_regular_file(found)) refuse(key, "there is no file " + found.lexically_normal().string());
    return found.lexically_normal().string();
  }
  std::vector<Override> overrides(const char* key) const {
    std::vector<Override> list;
    if (!has(key)) return list;
    if (!at(key).is_object()) refuse(key, "expected key paths and values");
    for (const auto& [name, value] : at(key).items())  // JSON is YAML, too
      list.push_back({.key = name, .value = value.dump(), .place = {path_, 0}});
    return list;
  }
  [[noreturn]] void refuse(const std::string& what) const { throw ConfigError({path_, 0}, where_ + what); }
  [[noreturn]] void refuse(const char* key, const std::string& what) const {
    std::string message = where_;
    message.append(".").append(key).append(": ").append(what);
    throw ConfigError({path_, 0}, message);
  }

 private:
  const std::string path_;
  const Json& map_;
  const std::string where_;
};

PerformanceSettings::Condition read_condition(const Experiment& experiment, const Json& item) {
  const Keys keys(experiment, item, "condition", {"name", "label", "set", "course", "controllet"});
  PerformanceSettings::Condition condition{.name = keys.text("name"),
                                           .label = keys.text("name"),
                                           .set = keys.overrides("set"),
                                           .course = keys.file("course"),
                                           .controllet = keys.text("controllet")};
  keys.read("label", condition.label);
  return condition;
}

PerformanceSettings::Switching read_switching(const Experiment& experiment, const Json& item) {
  const Keys keys(experiment, item, "switching",
                  {"scene", "trials", "controllets", "controllet", "feature", "bystander"});
  double trials = 50;
  keys.read("trials", trials);
  PerformanceSettings::Switching switching{.scene = keys.file("scene"),
                                           .trials = static_cast<std::size_t>(trials),
                                           .controllets = keys.texts("controllets"),
                                           .controllet = keys.text("controllet"),
                                           .feature = keys.text("feature"),
                                           .bystander = keys.text("bystander")};
  if (switching.controllets.size() != 2) keys.refuse("controllets", "expected two, which alternate");
  return switching;
}

PerformanceSettings::DelayCheck read_delay_check(const Experiment& experiment, const Json& item) {
  const Keys keys(experiment, item, "delay_check", {"delays_s", "duration_s", "set"});
  PerformanceSettings::DelayCheck check{.delays_s = {}, .set = keys.overrides("set")};
  keys.read("duration_s", check.duration_s);
  for (const auto& delay : keys.items("delays_s")) {
    if (!delay.is_number() || delay.get<double>() < 0) keys.refuse("delays_s", "expected numbers from 0");
    check.delays_s.push_back(delay.get<double>());
  }
  return check;
}

}  // namespace

PerformanceSettings performance_settings(const Experiment& experiment) {
  const Keys keys(experiment, experiment.settings, "settings",
                  {"scene", "plant", "duration_s", "fast_duration_s", "lead_s", "usage_every_s", "conditions",
                   "switching", "delay_check"});
  PerformanceSettings settings{
      .scene = keys.file("scene"), .conditions = {}, .switching = {}, .delay_check = {}};
  keys.read("plant", settings.plant);
  keys.read("duration_s", settings.duration_s);
  keys.read("fast_duration_s", settings.fast_duration_s);
  keys.read("lead_s", settings.lead_s);
  keys.read("usage_every_s", settings.usage_every_s);
  for (const auto& item : keys.items("conditions"))
    settings.conditions.push_back(read_condition(experiment, item));
  if (settings.conditions.empty()) keys.refuse("conditions", "expected at least one");
  if (keys.has("switching")) settings.switching = read_switching(experiment, keys.at("switching"));
  if (keys.has("delay_check")) settings.delay_check = read_delay_check(experiment, keys.at("delay_check"));
  return settings;
}

std::string changed_scene_text(const Experiment& experiment, const std::string& scene,
                               const std::string& plant, const std::vector<Override>& set) {
  Experiment one{
      .name = experiment.name, .path = experiment.path, .seed = experiment.seed, .scene = scene, .set = set};
  const ExperimentVariant variant{.name = experiment.name, .tags = {}, .set = {}};
  return task_scene_text(one, {.variant = &variant, .plant = plant, .repeat = 1});
}

OpenedScene changed_scene(const Experiment& experiment, const std::string& scene, const std::string& plant,
                          const std::vector<Override>& set) {
  const std::string text = changed_scene_text(experiment, scene, plant, set);
  OpenedScene opened{.registry = build_registry(scene_plugins(text, scene)), .scene = {}};
  opened.scene = parse_scene(text, scene, opened.registry);
  refuse_carried_arms(opened.scene, "an experiment");
  return opened;
}

}  // namespace multipanda
