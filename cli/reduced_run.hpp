#pragma once

#include <filesystem>
#include <string>

#include "cli/seen_run.hpp"
#include "scene/scene.hpp"

// Runs on physical arms with lower bounds for contact: the default of a scene's first run.
namespace multipanda::cli {

enum class Reduction { as_usual, asked, refused };  // neither option, --reduced, --full-speed

class ReducedRun {
 public:
  // `memory`: the file that names the scenes that have run; first_runs_file() by default.
  ReducedRun(const Scene& scene, Reduction reduction, std::filesystem::path memory);

  bool reduced() const { return !why_.empty(); }
  const std::string& text() const { return text_; }  // to be printed; empty: nothing to say
  void apply(Scene& scene) const;
  // After a run with the scene's timeline that succeeded. Returns why it does not count, to be printed;
  // empty: it does, or nothing is to be remembered. A file that cannot be written makes the next run a first
  // one again.
  std::string remember(const SeenRun& seen) const;

  static std::filesystem::path first_runs_file();  // $XDG_STATE_HOME/multipanda/first_runs

 private:
  std::filesystem::path memory_;
  std::string key_;  // of the scene; empty: nothing to remember
  std::string why_, text_;
};

}  // namespace multipanda::cli
