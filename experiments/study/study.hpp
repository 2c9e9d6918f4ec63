#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "experiments/experiment.hpp"

// A study as read from its file (docs/studies.md): a table of independent runs, every combination of choices
// with every seed. Python starts them (python/multipanda/study.py).
namespace multipanda {

struct StudyAxis {
  std::string name;
  std::vector<ExperimentVariant> choices;
};

struct Study {
  enum class Kind { scene, experiment, refine, program };

  std::string path, title;
  Kind kind = Kind::scene;
  // Path of the scene or experiment; name of the experiment to refine; first of `program`.
  std::string base;
  std::vector<std::string> program;  // arguments of a command, with {seed}, {out} and {KEY} of `set`
  std::vector<std::string> files;    // dependencies of a program: files, or folders with all of their
                                     // contents
  std::vector<Override> set;         // of the scene; of `refine`: options; of `program`: values for its words
  std::vector<StudyAxis> axes;       // every combination of their choices
  std::vector<Variation> vary;       // by the seed; scenes only
  std::vector<double> seeds;         // listed, or
  std::uint64_t first_seed = 1, seed_count = 1;  // ... in a row
  std::optional<double> seconds;                 // of each run; none: the scene's duration_s
  std::size_t repeats = 1;                       // of each variant; experiments only
  std::vector<std::string> only;                 // variants of the experiment; empty: all
  bool hidden = false;                           // hidden plants drawn by the seed; scenes only
  bool logs = false;                             // keep the logs; scenes only
};

// Throws ConfigError. Each choice is tried with the first ones of the other axes, so that an invalid value is
// refused before the first run.
Study load_study(const std::string& path);

// Everything that Python needs: the above, and `files`, which the runs depend on.
nlohmann::ordered_json to_json(const Study& study);

// Tries each choice with the first ones of the other axes. Throws ConfigError with the axis, the choice and
// the fault.
void check_choices(const Study& study);

// All files that affect a run, besides the program: scene, models, plug-ins, experiments, of all
// choices. Sorted.
std::vector<std::string> study_files(const Study& study);

}  // namespace multipanda
