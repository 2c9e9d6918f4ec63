#include <algorithm>
#include <filesystem>
#include <functional>
#include <regex>
#include <set>

#include "common/own_files.hpp"
#include "common/text.hpp"
#include "experiments/kinds.hpp"
#include "experiments/study/scene_run.hpp"
#include "experiments/study/study.hpp"
#include "experiments/task_runs.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;

// The values of choice `c` of axis `a`, and of the first choice of every other axis.
std::vector<Override> values_of(const Study& study, std::size_t a, std::size_t c) {
  std::vector<Override> values = study.set;
  for (std::size_t i = 0; i < study.axes.size(); ++i) {
    const auto& set = study.axes[i].choices[i == a ? c : 0].set;
    values.insert(values.end(), set.begin(), set.end());
  }
  return values;
}

using Visit = std::function<void(const std::vector<Override>&)>;

// Calls visit(values) once per choice; adds the name of the choice to its exceptions.
void each_choice(const Study& study, const Visit& visit) {
  visit(values_of(study, 0, 0));
  for (std::size_t a = 0; a < study.axes.size(); ++a) {
    for (std::size_t c = 1; c < study.axes[a].choices.size(); ++c) {
      try {
        visit(values_of(study, a, c));
      } catch (const std::exception& error) {
        throw ConfigError({study.path, 0}, "axis '" + study.axes[a].name + "', choice '" +
                                               study.axes[a].choices[c].name + "': " + error.what());
      }
    }
  }
}

// The scene runs for these values: one, or one per variant of an experiment.
std::vector<SceneRun> scene_runs(const Study& study, const std::vector<Override>& values) {
  if (study.kind == Study::Kind::scene) {
    SceneRun run{.scene = study.base, .set = values, .vary = study.vary};
    run.seconds = study.seconds;
    run.seed = study.seeds.empty() ? study.first_seed : static_cast<std::uint64_t>(study.seeds[0]);
    run.hidden = study.hidden;
    return {run};
  }
  if (study.kind != Study::Kind::experiment) return {};
  const Experiment experiment = load_experiment(study.base);
  std::vector<std::string> only = study.only;
  std::vector<Override> set;  // of the scene; `only` chooses variants
  for (const auto& value : values) {
    if (value.key == "only") {
      only = {value.value};
    } else {
      set.push_back(value);
    }
  }
  const auto variants = chosen_variants(experiment, only);
  if (experiment.kind != kTaskKind) {
    if (!set.empty())
      throw std::invalid_argument("values need an experiment that runs a scene; " + experiment.name +
                                  " is of kind " + experiment.kind);
    return {};
  }
  std::vector<SceneRun> runs;
  for (const auto* variant : variants) {
    SceneRun run{.scene = experiment.scene, .set = experiment.set, .vary = {}};
    run.set.insert(run.set.end(), variant->set.begin(), variant->set.end());
    run.set.insert(run.set.end(), set.begin(), set.end());
    runs.push_back(run);
  }
  return runs;
}

// The experiment that these values refine.
std::string refined(const Study& study, const std::vector<Override>& values) {
  static const std::vector<std::string> kOptions{"drives",  "family", "plant",  "refine",
                                                 "repeats", "rounds", "variant"};
  std::string name = study.base;
  for (const auto& [key, value, place] : values) {
    if (std::find(kOptions.begin(), kOptions.end(), key) == kOptions.end())
      throw ConfigError(place, "refine has no option '" + key + "' here" +
                                   name_hint(key, kOptions, "there are no options"));
    if (key == "refine") name = value;
  }
  return name;
}

// Every {NAME} in the words has a value, and every value is used.
void check_words(const Study& study, const std::vector<Override>& values) {
  std::set<std::string> names, given{"seed", "out"};
  static const std::regex kName("\\{([a-z][a-z0-9_]*)\\}");
  for (const auto& word : study.program) {
    for (std::sregex_iterator found(word.begin(), word.end(), kName), end; found != end; ++found)
      names.insert((*found)[1]);
  }
  for (const auto& [key, value, place] : values) {
    if (key == "seed" || key == "out")
      throw ConfigError(place, "the study itself gives {" + key + "} a value; choose another name");
    if (!names.contains(key)) throw ConfigError(place, "no argument in `program` contains {" + key + "}");
    given.insert(key);
  }
  for (const auto& name : names) {
    if (!given.contains(name))
      throw ConfigError({study.path, 0}, "{" + name + "} in `program` has no value; expected a key '" + name +
                                             "' in `set` or in every choice of an axis");
  }
  if (!names.contains("out"))
    throw ConfigError({study.path, 0},
                      "no argument of `program` contains {out}, the folder into which it writes result.json");
}

void check_values(const Study& study, const std::vector<Override>& values) {
  if (study.kind == Study::Kind::program) check_words(study, values);
  if (study.kind == Study::Kind::refine) (void)load_experiment(refined(study, values));
  for (const auto& run : scene_runs(study, values)) check_scene_run(run);
}

}  // namespace

void check_choices(const Study& study) {
  each_choice(study, [&](const auto& values) { check_values(study, values); });
}

std::vector<std::string> study_files(const Study& study) {
  std::set<std::string> files;
  const auto add = [&](const fs::path& file) {
    if (!file.empty()) files.insert(fs::absolute(file).lexically_normal().string());
  };
  if (study.kind == Study::Kind::program) {
    for (const auto& word : study.program) {
      if (fs::is_regular_file(word)) add(word);
    }
    for (const auto& file : study.files) {
      if (!fs::is_directory(file)) add(file);
      if (!fs::is_directory(file)) continue;
      for (const auto& entry : fs::recursive_directory_iterator(file)) {
        if (entry.is_regular_file()) add(entry.path());
      }
    }
    return {files.begin(), files.end()};
  }
  const auto add_folder = [&](const fs::path& folder) {
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      const auto ending = entry.path().extension();
      if (ending == ".yaml" || ending == ".urdf" || ending == ".xml" || ending == ".py") add(entry.path());
    }
  };
  add_folder(share_folder() / "models");
  if (study.kind == Study::Kind::scene) {
    add(study.base);
  } else {
    add_folder(experiments_folder());
  }
  each_choice(study, [&](const auto& values) {
    if (study.kind != Study::Kind::scene) {
      const bool refine = study.kind == Study::Kind::refine;
      const Experiment experiment = load_experiment(refine ? refined(study, values) : study.base);
      add(experiment.path);
      add(experiment.scene);
    }
    for (const auto& run : scene_runs(study, values)) {
      for (const auto& file : scene_files(run)) add(file);
    }
  });
  return {files.begin(), files.end()};
}

}  // namespace multipanda
