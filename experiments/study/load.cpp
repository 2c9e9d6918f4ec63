#include "scene/load.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "common/text.hpp"
#include "experiments/study/study.hpp"
#include "scene/rewrite.hpp"
#include "yaml_reader/archive.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// The short form of choices: the values of one key.
void add_values(Archive& archive, StudyAxis& axis) {
  std::string key;
  archive(Key("key", "Key path whose values are the choices; instead of `choices`."), key);
  for (const Node& value : archive.names(Key("values", "The values of `key`."))) {
    const std::string text = yaml_text(value.yaml());
    axis.choices.push_back({.name = text,
                            .label = axis.name + " " + text,
                            .tags = {text},
                            .set = {{.key = key, .value = text, .place = value.place()}}});
  }
  if (!archive.reading()) return;
  if (archive.has("values") != archive.has("key"))
    archive.self().refuse("`key` and `values` belong together");
  if (axis.choices.empty())
    archive.self().refuse("axis '" + axis.name +
                          "' has no choices; expected `choices`, or `key` and `values`");
  std::set<std::string> seen;
  for (const auto& choice : axis.choices) {
    if (!seen.insert(choice.name).second)
      archive.self().refuse("two choices are called '" + choice.name + "'; names must differ");
  }
}

}  // namespace

void visit(Archive& archive, StudyAxis& axis) {
  archive.about("Axis", "Choices of one kind; every combination of all axes is run.");
  archive(Key("name", "What is chosen: a column of the table.").identifier().required(), axis.name);
  archive.list(Key("choices", "The choices: `name`, `label`, `set`."), axis.choices);
  add_values(archive, axis);
}

namespace {

void visit_seeds(Archive& archive, Study& study) {
  archive.about("Seeds", "Seeds in a row.");
  archive(Key("first", "The first one.").within(0, 1e9), study.first_seed);
  archive(Key("count", "How many.").within(1, 1e7).required(), study.seed_count);
}

std::string absolute(const std::string& path) { return fs::absolute(path).lexically_normal().string(); }

void read_program(const Archive& archive, Study& study) {
  const Node words = archive.at("program");
  if (study.program.empty()) words.refuse("`program` has no words");
  for (auto& word : study.program) {
    const std::string file = absolute(words.resolved(word));
    if (fs::is_regular_file(file)) word = file;
  }
  study.base = study.program.front();
  if (study.base.find('/') != std::string::npos && !fs::is_regular_file(study.base))
    words.refuse("there is no program " + absolute(words.resolved(study.base)));
  for (auto& file : study.files) {
    file = absolute(archive.at("files").resolved(file));
    if (!fs::exists(file)) archive.at("files").refuse("there is no " + file);
  }
}

void read_base(Archive& archive, Study& study) {
  std::string scene, experiment, refine;
  std::vector<std::string>& program = study.program;
  archive(Key("scene", "Name or file of a scene, relative to this file."), scene);
  archive(Key("experiment", "Name or file of an experiment."), experiment);
  archive(Key("refine", "Name of an experiment that `multipanda refine` adapts to hidden plants."), refine);
  archive(
      Key("program",
          "A command with its arguments that writes result.json into the folder {out}. {seed} is the seed, "
          "{KEY} a value of `set`. Arguments that name a file, relative to this one, become its path."),
      program);
  archive(Key("files", "Files and folders that the program depends on, relative to this file."), study.files);
  if (!archive.reading()) return;
  const auto bases = archive.present({"scene", "experiment", "refine", "program"});
  if (bases.size() != 1)
    archive.self().refuse("expected one of the keys 'scene', 'experiment', 'refine' and 'program'; found " +
                          std::to_string(bases.size()));
  study.base = scene + experiment + refine;
  study.kind = bases.front() == "scene"        ? Study::Kind::scene
               : bases.front() == "experiment" ? Study::Kind::experiment
               : bases.front() == "refine"     ? Study::Kind::refine
                                               : Study::Kind::program;
  if (study.kind == Study::Kind::program) return read_program(archive, study);
  const bool file = study.base.find('/') != std::string::npos || study.base.ends_with(".yaml");
  if (study.kind == Study::Kind::scene && !file) {
    study.base = (fs::path(scenes_folder()) / (study.base + ".yaml")).string();
  } else if (file) {
    study.base = absolute(archive.at(bases.front()).resolved(study.base));  // workers have other folders
  }
  if (study.kind == Study::Kind::experiment) study.base = load_experiment(study.base).path;
  if (study.kind == Study::Kind::refine) (void)load_experiment(study.base);
  if (study.kind == Study::Kind::scene && !fs::is_regular_file(study.base))
    archive.at("scene").refuse("there is no scene " + study.base);
}

// Keys that mean nothing for the study's kind are refused instead of ignored.
void check_kind(const Archive& archive, const Study& study) {
  std::vector<std::string> foreign;
  if (study.kind != Study::Kind::scene) foreign = {"vary", "seconds", "hidden", "logs"};
  if (study.kind != Study::Kind::experiment) {
    foreign.emplace_back("only");
    foreign.emplace_back("repeats");
  }
  if (study.kind != Study::Kind::program) foreign.emplace_back("files");
  for (const auto& key : archive.present(foreign))
    archive.at(key).refuse("the key '" + key + "' has no meaning here" +
                           (study.kind == Study::Kind::refine ? "; options of refine belong in 'set'" : ""));
  if (archive.has("seeds") && archive.has("seed_list"))
    archive.at("seed_list").refuse("`seeds` and `seed_list` exclude each other; remove one");
}

}  // namespace

void visit(Archive& archive, Study& study) {
  archive.about("Study", "The top level of the file.");
  archive(Key("title", "Title. Default: the file's name."), study.title);
  read_base(archive, study);
  study.set = read_overrides(
      archive,
      "Values of every run, by key path; of `refine`: its options; of `program`: values for its arguments.");
  archive.list(Key("axes", "What differs between runs.").each("axis"), study.axes);
  archive.list(Key("vary", "Values that vary with the seed."), study.vary);
  archive(Key("seed_list", "Seeds one by one, instead of `seeds`.").no_default(), study.seeds);
  archive.part(Key("seeds", "Seeds in a row. Default: 1."),
               [&](Archive& inner) { visit_seeds(inner, study); });
  archive(
      Key("seconds", "Duration of each run. Default: the scene's `duration_s`.").in("s").within(0.001, 1e6),
      study.seconds);
  archive(Key("repeats", "Repeats of each variant of the experiment.").within(1, 1000), study.repeats);
  archive(Key("only", "Variants of the experiment. Default: all."), study.only);
  archive(Key("hidden", "Whether the simulated arms differ from their models at random, by the seed."),
          study.hidden);
  archive(Key("logs", "Whether the log of each run is kept."), study.logs);
  if (!archive.reading()) return;
  check_kind(archive, study);
  for (const double seed : study.seeds) {
    if (seed < 0 || seed > 1e9 || seed != std::floor(seed))
      archive.at("seed_list").refuse("expected whole numbers from 0 to 1e9");
  }
}

namespace {

Json overrides(const std::vector<Override>& list) {
  Json json = Json::array();
  for (const auto& change : list) json.push_back({change.key, change.value});
  return json;
}

}  // namespace

Study load_study(const std::string& path) {
  Study study;
  study.path = path;
  study.title = fs::path(path).stem().string();
  Archive::read(Node::parse(read_text(path), path), study);
  check_choices(study);
  return study;
}

Json to_json(const Study& study) {
  static constexpr const char* kKinds[] = {"scene", "experiment", "refine", "program"};
  Json json{{"path", fs::absolute(study.path).lexically_normal().string()},
            {"title", study.title},
            {"kind", kKinds[static_cast<std::size_t>(study.kind)]},
            {"base", study.base},
            {"program", study.program},
            {"set", overrides(study.set)},
            {"axes", Json::array()},
            {"vary", Json::array()},
            {"repeats", study.repeats},
            {"only", study.only},
            {"hidden", study.hidden},
            {"logs", study.logs},
            {"files", study_files(study)}};
  if (study.kind == Study::Kind::scene) json["base"] = fs::absolute(study.base).lexically_normal().string();
  for (const auto& axis : study.axes) {
    Json choices = Json::array();
    for (const auto& choice : axis.choices)
      choices.push_back({{"name", choice.name}, {"label", choice.label}, {"set", overrides(choice.set)}});
    json["axes"].push_back({{"name", axis.name}, {"choices", choices}});
  }
  for (const auto& change : study.vary) json["vary"].push_back({change.key, change.by});
  if (study.seconds) json["seconds"] = *study.seconds;
  if (study.seeds.empty()) {
    json["seeds"] = {{"first", study.first_seed}, {"count", study.seed_count}};
  } else {
    json["seeds"] = Json::array();
    for (const double seed : study.seeds) json["seeds"].push_back(static_cast<std::uint64_t>(seed));
  }
  return json;
}

}  // namespace multipanda
