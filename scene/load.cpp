#include "scene/load.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <yaml-cpp/yaml.h>

#include "common/own_files.hpp"
#include "common/text.hpp"
#include "scene/build.hpp"
#include "scene/load_parts.hpp"

namespace multipanda {

namespace {

namespace fs = std::filesystem;

std::string plugin_path(const Node& item) {
  std::string path = item.resolved(item.yaml().Scalar());
  if (!fs::exists(path)) item.refuse("there is no file " + path + "; build it first");
  return path;
}

std::string found_scene(const std::string& name) {
  const bool path = name.find('/') != std::string::npos || name.ends_with(".yaml") || name.ends_with(".yml");
  if (path) {
    if (fs::is_directory(name))
      throw ConfigError({name, 0}, "this is a folder; expected a scene file inside it");
    if (!fs::is_regular_file(name)) throw ConfigError({name, 0}, "there is no such file");
    return name;
  }
  const fs::path file = fs::path(scenes_folder()) / (name + ".yaml");
  if (!fs::is_regular_file(file)) {
    throw ConfigError({name, 0}, "there is no scene of this name in " + scenes_folder() +
                                     name_hint(name, available_scenes(), "there are no scenes") +
                                     " (a path needs a slash or the ending .yaml)");
  }
  return file.string();
}

// The top level of a scene file, of which only `plugins` is read; other keys are ignored.
std::vector<std::string> plugins_of(const Node& root) {
  std::vector<std::string> paths;
  if (!root.is_map()) return paths;
  for (const auto& [key, value] : root.pairs()) {
    if (key != "plugins") continue;
    for (const auto& item : value.names(Key("plugins", ""))) paths.push_back(plugin_path(item));
  }
  return paths;
}

Scene read_scene(const Node& root, const std::string& text, const Registry& registry) {
  SceneReader reader(registry);
  Archive::read(root, reader);
  reader.scene.text = text;
  reader.scene.path = root.file();
  if (reader.scene.name.empty()) reader.scene.name = fs::path(root.file()).stem().string();
  return std::move(reader.scene);
}

}  // namespace

std::string scenes_folder() { return (share_folder() / "config" / "scenes").string(); }

std::vector<std::string> available_scenes() {
  std::vector<std::string> names;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(scenes_folder(), missing)) {
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<std::string> scene_plugins(const std::string& text, const std::string& file_name) {
  return plugins_of(Node::parse(text, file_name));
}

Scene parse_scene(const std::string& text, const std::string& file_name, const Registry& registry) {
  return read_scene(Node::parse(text, file_name), text, registry);
}

Scene load_scene(const std::string& path_or_bare_name, const Registry& registry) {
  const std::string path = found_scene(path_or_bare_name);
  return parse_scene(read_text(path), path, registry);
}

namespace {

OpenedScene opened_scene(const std::string& path, const std::string& text) {
  const Node root = Node::parse(text, path);
  OpenedScene opened;
  try {
    opened.registry = build_registry(plugins_of(root));
  } catch (const ConfigError&) {
    throw;
  } catch (const std::exception& error) {
    root.key_of("plugins").called("plugins").refuse(error.what());
  }
  opened.scene = read_scene(root, text, opened.registry);
  return opened;
}

}  // namespace

OpenedScene open_scene(const std::string& path_or_bare_name, const SceneAdditions& additions) {
  const std::string path = found_scene(path_or_bare_name);
  const std::string text = read_text(path);
  OpenedScene opened = opened_scene(path, text);
  if (additions.empty()) return opened;
  return opened_scene(path, with_additions(text, path, additions));
}

void visit(Archive& archive, ContactBounds& bounds, Scene& scene) {
  const ContactBounds usual;
  archive.about("ContactBounds", "Bounds for a hand beside a person; values above the default lift them.");
  const auto bound = [&](const char* key, const char* doc, double most, double usual_value, const char* unit,
                         double& value) {
    archive(Key(key, doc).within(0.01, most), value);
    if (archive.reading() && value > usual_value) {
      scene.lifted.push_back(std::string(key) + ": " + number_text(value) + " " + unit + ", usually " +
                             number_text(usual_value) + " " + unit);
    }
  };
  bound("hand_speed_m_per_s", "Largest speed at which set-points move the hand, joint set-points included.",
        3, usual.hand_speed, "m/s", bounds.hand_speed);
  bound("spring_force_n", "Largest force with which a set-point pulls a hand that cannot follow.", 1000,
        usual.spring_force, "N", bounds.spring_force);
  bound("spring_moment_nm", "Largest moment of the same.", 300, usual.spring_moment, "N m",
        bounds.spring_moment);
}

void visit(Archive& archive, SceneReader& reader) {
  Scene& scene = reader.scene;
  archive.about("Scene", "The top level of the file.");
  archive.collect();
  archive(Key("name", "Name in logs and reports. Default: the name of the file.").identifier(), scene.name);
  archive(Key("description", "Description for readers."), scene.description);
  archive(Key("seed", "Seed of all random numbers: two unpaced runs with the same seed are identical.")
              .within(0, 9007199254740992.0),
          scene.seed);
  archive(Key("duration_s", "Duration of a run; 0: until stopped.").within(0, kLongestTime),
          scene.duration_s);
  archive.section(Key("plant", "Simulation fidelity."), scene.plant, scene);
  archive(Key("backend",
              "What drives the arms: `mujoco`, `fci`, `virtual`, `pinocchio`, or a backend of a library in "
              "`plugins`. Default: arms with the key `fci` are real, the others simulated."),
          scene.backend);
  for (const auto& item : archive.names(Key(
           "plugins", "Libraries with your own controllets, features and backends, relative to this file.")))
    scene.plugins.push_back(plugin_path(item));
  archive.list(Key("arms", "1 to 16 arms.").each("arm").required(), scene.arms, reader);
  if (archive.reading() && archive.sound() && (scene.arms.empty() || scene.arms.size() > kMaxArms)) {
    archive.at("arms").refuse("expected 1 to " + std::to_string(kMaxArms) + " arms, found " +
                              std::to_string(scene.arms.size()));
  }
  const auto is_real = [](const SceneArm& arm) { return arm.fci.has_value(); };
  if (std::any_of(scene.arms.begin(), scene.arms.end(), is_real))
    refuse_carried_arms(scene, "a run with a real arm (key 'fci')");
  archive.list(Key("objects", "Surfaces and bodies.").each("object"), scene.objects, reader);
  archive.section(Key("contact_bounds",
                      "Bounds for arms beside people, for all controllets; larger values lift them, and the "
                      "run reports it. Not a certified safety function: see docs/contact.md."),
                  scene.contact_bounds, scene);
  archive.settle();  // controllets name arms
  archive.list(
      Key("controllets",
          "Controllet instances. All are built before the first cycle; switches decide which of them run. "
          "Every arm also has a built-in `<arm>_hold`, which runs when no other controllet owns the arm.")
          .each("controllet"),
      scene.controllets, reader);
  for (auto& config : scene.controllets) config.contact = scene.contact_bounds;
  if (scene.controllets.size() + reader.holds.size() > kMaxInstances) {
    archive.at("controllets")
        .refuse("expected at most " + std::to_string(kMaxInstances - scene.arms.size()) + " (" +
                std::to_string(kMaxInstances) + " with the holds of the arms), found " +
                std::to_string(scene.controllets.size()));
  }
  archive.settle();
  note_near_leaders(scene);
  read_active(archive, reader);
  read_timeline(archive, reader);
  archive.section(Key("ros", "How `run --ros` shows the run in ROS 2."), scene.ros);
}

Scene with_values(const OpenedScene& opened, const std::vector<std::string>& settings) {
  YAML::Node root = YAML::Load(opened.scene.text);
  for (const auto& setting : settings) {
    const SourcePlace place{"--set", 0};
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos || equals == 0)
      throw ConfigError(place, "expected KEY=VALUE, found " + in_quotes(setting));
    try {
      put(root, {.key = setting.substr(0, equals), .value = setting.substr(equals + 1), .place = place});
    } catch (const YAML::Exception& error) {
      throw ConfigError(place, in_quotes(setting) + " is not YAML: " + error.what());
    }
  }
  return parse_scene(yaml_text(root) + "\n", opened.scene.path, opened.registry);
}

}  // namespace multipanda
