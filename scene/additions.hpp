#pragma once

#include <string>
#include <vector>

namespace multipanda {

// What a caller adds to a scene without changing its file.
struct SceneAdditions {
  std::vector<std::string> plugins;  // paths of libraries, relative to where the program runs
  std::vector<std::string>
      controllets;  // each as an entry of `controllets` in YAML, on one line: {name: soft, ...}

  bool empty() const { return plugins.empty() && controllets.empty(); }
};

// The scene's text with the additions at the beginning of its lists, so that a log has all that the run had.
// Throws ConfigError: the file cannot be read as YAML, or one of the lists is none.
std::string with_additions(const std::string& text, const std::string& file_name,
                           const SceneAdditions& additions);

}  // namespace multipanda
