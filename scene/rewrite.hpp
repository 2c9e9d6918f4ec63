#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "core/types/spatial.hpp"
#include "yaml_reader/config_error.hpp"

namespace YAML {
class Node;
}

// Scene files changed by programs. Writing a whole tree loses comments, layout and line numbers. Additions
// alone keep the text around them, because messages refer to its lines.
namespace multipanda {

// A value that replaces one of the scene file before the scene is read. The key is a path:
// "objects.table.friction". Items of a list are addressed by name, by number from 0, or by a key
// that they have (the first that has it). The last key may be new, everything before it must be there.
struct Override {
  std::string key;
  std::string value;  // as YAML
  SourcePlace place;
};

// A number in the scene, or each of a list, that varies in every repeat: uniform within +- `by`, seeded.
struct Variation {
  std::string key;
  double by = 0;
  SourcePlace place;
};

// Uniform in [-1, 1) from the generator's bits, so that every standard library gives the same numbers.
class SeededDraw {
 public:
  SeededDraw(std::uint64_t seed, std::uint64_t repeat) : bits_(seed * 1'000'003 + repeat) {
    for (int i = 0; i < 8; ++i) bits_();  // the first numbers of adjacent seeds are similar
  }
  double operator()() { return static_cast<double>(bits_() >> 11) * 0x1p-52 - 1.0; }

 private:
  std::mt19937_64 bits_;
};

std::string yaml_text(const YAML::Node& node);
// Each throws ConfigError at the place of the change if the path does not exist or does not lead to
// plain numbers.
void put(YAML::Node& root, const Override& change);
void vary(YAML::Node& root, const Variation& change, SeededDraw& draw);

// The scene with another base of the named arm, below a comment with the note. Throws ConfigError without it.
std::string with_base(const std::string& scene_text, const std::string& arm, const Pose& X_WB,
                      const std::string& note);

// Additions of a caller to a scene, without changing its file.
struct SceneAdditions {
  std::vector<std::string> plugins;      // paths of libraries, relative to where the program runs
  std::vector<std::string> controllets;  // entries of `controllets`, each YAML on one line: {name: soft, ...}

  bool empty() const { return plugins.empty() && controllets.empty(); }
};

// The scene's text with the additions at the beginning of its lists, so that a log contains the complete
// scene. Throws ConfigError: the file cannot be read as YAML, or one of the lists is not a list.
std::string with_additions(const std::string& text, const std::string& file_name,
                           const SceneAdditions& additions);

}  // namespace multipanda
