#pragma once

#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "scene/rewrite.hpp"
#include "scene/scene.hpp"

// Scene files, read and checked (docs/scene_reference.md). Off the loop only. Everything here throws
// ConfigError: file, line, what was found, what was expected, the nearest valid name.
namespace multipanda {

// Reads a scene by bare name ("two_arms": config/scenes/two_arms.yaml of the project, or of the folder in the
// environment variable MULTIPANDA_SHARE) or by path (anything with a slash or ending in .yaml or .yml).
// `registry` must already have the controllets of the scene's plugins; open_scene does both.
Scene load_scene(const std::string& path_or_bare_name, const Registry& registry);

// The same from text. Messages show `file_name`; relative paths start in its folder.
Scene parse_scene(const std::string& text, const std::string& file_name, const Registry& registry);

// A scene together with the types that it can name.
struct OpenedScene {
  Registry registry;  // multipanda's own and the plugins' controllets and features
  Scene scene;
};
// The scene must also be valid without the additions; its text contains them.
OpenedScene open_scene(const std::string& path_or_bare_name, const SceneAdditions& additions = {});

// Paths of the libraries that a scene names. Other keys are not checked.
std::vector<std::string> scene_plugins(const std::string& text, const std::string& file_name);

// Bare names that load_scene knows, sorted.
std::vector<std::string> available_scenes();
// Folder that holds them.
std::string scenes_folder();

// docs/scene_reference.md: every key of a scene file and every controllet and feature that it can name,
// written from the code that reads scenes and from the controllets' own descriptors.
std::string scene_reference_markdown(const Registry& registry);
// config/schemas/scene.json: the same as JSON Schema, for editors.
std::string scene_json_schema(const Registry& registry);

// The scene read again with other values, each "KEY=VALUE" as in an Override. Its text contains them, for the
// log; lines in messages are those of that text. Throws ConfigError: no such key, or a value that the scene
// does not accept.
Scene with_values(const OpenedScene& opened, const std::vector<std::string>& settings);

}  // namespace multipanda
