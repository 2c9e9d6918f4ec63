#include "scene/load.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "scene/build.hpp"
#include "scene/load_parts.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLargestFile = 1 << 20;  // [bytes] nobody writes more by hand

// Line where a second YAML document begins, or 0. Found by hand: YAML::LoadAll never ends on some broken
// texts.
int second_document(const std::string& text) {
  std::istringstream in(text);
  std::string line;
  bool content = false;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line == "..." || line == "---" || line.starts_with("--- ")) {
      if (content) return number;
    } else {
      content = content || (!line.empty() && line[0] != '#' && line[0] != '%');
    }
  }
  return 0;
}

YAML::Node parse_yaml(const std::string& text, const std::string& file_name) try {
  if (text.size() > kLargestFile)
    throw SceneError({file_name, 0}, "larger than 1 MiB; this is no scene file");
  const YAML::Node root = YAML::Load(text);  // the first document
  if (!root.IsDefined() || root.IsNull()) {
    throw SceneError({file_name, 1}, "empty; expected a mapping with at least the key 'arms'");
  }
  if (const int line = second_document(text); line > 0) {
    throw SceneError({file_name, line}, "expected one YAML document, found a second one");
  }
  return root;
} catch (const YAML::Exception& error) {
  throw SceneError({file_name, error.mark.line + 1}, "not readable as YAML: " + error.msg);
}

// What yaml-cpp itself refuses later on (a node used as something that it is not) would be a gap in our own
// checks; it must still be a refusal, not a crash.
template <typename Work>
auto guarded(const std::string& file_name, Work work) try {
  return work();
} catch (const YAML::Exception& error) {
  throw SceneError({file_name, error.mark.line + 1}, error.msg);
}

SceneFile scene_file(const std::string& file_name) {
  return {file_name, fs::path(file_name).parent_path().string()};
}

Mapping root_of(const SceneFile& file, const std::string& text) {
  return {Entry(file, parse_yaml(text, file.name), 1, ""), schema::scene()};
}

std::string relative_to(const SceneFile& file, const std::string& path) {
  return fs::path(path).is_absolute() ? path : (fs::path(file.folder) / path).lexically_normal().string();
}

std::vector<std::string> plugins_of(const Mapping& root) {
  std::vector<std::string> paths;
  for (const auto& item : root.text_items("plugins")) {
    paths.push_back(relative_to(item.file(), item.node().Scalar()));
    if (!fs::exists(paths.back())) item.refuse("there is no file " + paths.back() + "; build it first");
  }
  return paths;
}

std::string found_scene(const std::string& name) {
  const bool path = name.find('/') != std::string::npos || name.ends_with(".yaml") || name.ends_with(".yml");
  if (path) {
    if (!fs::is_regular_file(name)) throw SceneError({name, 0}, "there is no such file");
    return name;
  }
  const fs::path file = fs::path(scenes_folder()) / (name + ".yaml");
  if (!fs::is_regular_file(file)) {
    throw SceneError({name, 0}, "there is no scene of this name in " + scenes_folder() +
                                    name_hint(name, available_scenes(), "there are no scenes") +
                                    " (a path needs a slash or the ending .yaml)");
  }
  return file.string();
}

std::string read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw SceneError({path, 0}, "cannot be read");
  return text.str();
}

Scene read_scene(const Mapping& root, const std::string& text, const Registry& registry) {
  SceneReader reader(registry);
  Scene& scene = reader.scene;
  scene.text = text;
  scene.path = root.self().file().name;
  if (root.has("name")) {
    scene.name = root.text("name");
  } else {
    scene.name = fs::path(scene.path).stem().string();
  }
  scene.description = root.text("description");
  scene.seed = static_cast<std::uint64_t>(root.number("seed"));
  scene.duration_s = root.number("duration_s");
  scene.plugins = plugins_of(root);
  read_plant(root, reader);
  read_arms(root, reader);
  read_objects(root, reader);
  read_controllets(root, reader);
  read_active(root, reader);
  read_timeline(root, reader);
  read_ros(root, reader);
  return std::move(reader.scene);
}

}  // namespace

std::string scenes_folder() {
  const char* share = std::getenv("MULTIPANDA_SHARE");
  const fs::path root = share != nullptr && *share != '\0' ? share : MULTIPANDA_DEFAULT_SHARE;
  return (root / "config" / "scenes").string();
}

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
  const SceneFile file = scene_file(file_name);
  return guarded(file_name, [&] { return plugins_of(root_of(file, text)); });
}

Scene parse_scene(const std::string& text, const std::string& file_name, const Registry& registry) {
  const SceneFile file = scene_file(file_name);
  return guarded(file_name, [&] { return read_scene(root_of(file, text), text, registry); });
}

Scene load_scene(const std::string& path_or_bare_name, const Registry& registry) {
  const std::string path = found_scene(path_or_bare_name);
  return parse_scene(read_file(path), path, registry);
}

OpenedScene open_scene(const std::string& path_or_bare_name) {
  const std::string path = found_scene(path_or_bare_name);
  const std::string text = read_file(path);
  const SceneFile file = scene_file(path);
  OpenedScene opened;
  try {
    opened.registry = build_registry(scene_plugins(text, path));
  } catch (const SceneError&) {
    throw;
  } catch (const std::exception& error) {
    const Entry place = root_of(file, text).entry("plugins");
    place.refuse(error.what());
  }
  opened.scene = parse_scene(text, path, opened.registry);
  return opened;
}

}  // namespace multipanda
