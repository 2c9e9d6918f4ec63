#include "study/scene_run.hpp"

#include <algorithm>
#include <chrono>
#include <map>

#include "config_file/node.hpp"
#include "config_file/text.hpp"
#include "core/model/model_terms.hpp"
#include "experiments/seeded_draw.hpp"
#include "experiments/yaml_tree.hpp"
#include "models/robot_description.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/carried_arms.hpp"
#include "scene/hidden_plant.hpp"
#include "study/run_figures.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string scene_text(const SceneRun& run) {
  YAML::Node root = YAML::Load(read_text(run.scene));
  for (const auto& change : run.set) put(root, change);
  root["seed"] = std::to_string(run.seed);
  SeededDraw draw(run.seed, 0);
  for (const auto& change : run.vary) vary(root, change, draw);
  return yaml_text(root) + "\n";
}

// Runs of one process use the same few libraries.
const Registry& registry_of(const std::string& text, const std::string& path) {
  static std::map<std::vector<std::string>, Registry> known;
  const auto plugins = scene_plugins(text, path);
  const auto found = known.find(plugins);
  return found != known.end() ? found->second : known.emplace(plugins, build_registry(plugins)).first->second;
}

Scene scene_of(const SceneRun& run, const Registry*& registry) {
  const std::string text = scene_text(run);
  registry = &registry_of(text, run.scene);
  Scene scene = parse_scene(text, run.scene, *registry);
  refuse_carried_arms(scene, "a study");
  for (const auto& arm : scene.arms) {
    if (arm.fci)
      throw std::invalid_argument(run.scene + ": arm '" + arm.name +
                                  "' is a real one; a study runs simulated arms only: remove its key 'fci'");
  }
  if (!run.seconds && scene.duration_s == 0)
    throw std::invalid_argument(run.scene +
                                ": expected a duration: 'seconds' of the study, or the scene's "
                                "duration_s");
  if (run.hidden) hide(scene, run.seed);
  return scene;
}

// Where each arm's flange is at the end, in the world: it depends on the joints alone.
void add_flanges(const Session& session, Json& figures) {
  for (std::size_t i = 0; i < session.layout().arms.size(); ++i) {
    const std::string& name = session.layout().arms[i].name;
    const auto q = figures[name + "/q_end_rad"].get<std::vector<double>>();
    if (q.empty()) continue;  // not one cycle
    JointVector joints(static_cast<Eigen::Index>(q.size()));
    std::copy(q.begin(), q.end(), joints.data());
    ModelTerms terms(session.models()[i]);
    terms.update(joints, JointVector::Zero(joints.size()));
    const Vector3& p_WF = terms.X_WF().position;
    for (std::size_t axis = 0; axis < 3; ++axis)
      figures[name + "/flange_end_" + "xyz"[axis] + "_m"] = p_WF[static_cast<Eigen::Index>(axis)];
  }
}

double since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

SceneRun scene_run_from(const Json& json) {
  try {
    SceneRun run{.scene = json.at("scene").get<std::string>()};
    for (const auto& change : json.at("set"))
      run.set.push_back({.key = change.at(0), .value = change.at(1), .place = {run.scene, 0}});
    for (const auto& change : json.at("vary"))
      run.vary.push_back({.key = change.at(0), .by = change.at(1), .place = {run.scene, 0}});
    run.seed = json.at("seed");
    if (json.contains("seconds") && !json["seconds"].is_null()) run.seconds = json["seconds"].get<double>();
    run.hidden = json.value("hidden", false);
    run.log = json.value("log", "");
    return run;
  } catch (const Json::exception& error) {
    throw std::invalid_argument(std::string("not a run of a study: ") + error.what());
  }
}

void check_scene_run(const SceneRun& run) {
  const Registry* registry = nullptr;
  (void)scene_of(run, registry);
}

std::vector<std::string> scene_files(const SceneRun& run) {
  const Registry* registry = nullptr;
  const Scene scene = scene_of(run, registry);
  std::vector<std::string> files = scene.plugins;
  for (const auto& arm : scene.arms) {
    for (const std::string& model : {arm.model, arm.plant_model}) {
      if (model.empty()) continue;
      for (const auto& file : robot_files(model)) files.push_back(file.string());
    }
  }
  return files;
}

Json run_scene(const SceneRun& run) {
  const auto begin = std::chrono::steady_clock::now();
  const Registry* registry = nullptr;
  Scene scene = scene_of(run, registry);
  std::vector<std::string> objects;
  for (const auto& object : scene.objects) {
    if (!object.fixed) objects.push_back(object.name);
  }
  SessionOptions options{.paced = false, .duration_s = run.seconds};
  const fs::path scratch = fs::path(run.log).concat(".part");
  options.thread.lock_memory = false;  // it takes 8 ms, and only the wall clock would notice
  if (!run.log.empty()) options.record = scratch;
  std::optional<RunFigures> figures;
  options.observer = [&figures](const CycleRecord& record) { figures->take(record); };
  std::vector<std::optional<Pose>> poses(objects.size());
  options.on_loop = [&](const Tick&, const Backend& backend) {
    for (std::size_t i = 0; i < objects.size(); ++i) poses[i] = backend.object_pose(objects[i]);
  };
  Session session(std::move(scene), *registry, std::move(options));
  figures.emplace(session.layout());
  session.start();
  while (!session.wait_for_end(60)) continue;
  const RunSummary summary = session.finish();
  Json result{{"figures", figures->json()}, {"success", summary.success()}, {"faults", summary.faults()}};
  add_flanges(session, result["figures"]);
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (!poses[i]) continue;
    const auto& p = poses[i]->position;
    result["figures"][objects[i] + "/position_m"] = {p.x(), p.y(), p.z()};
  }
  if (!run.log.empty()) {
    fs::rename(summary.log, run.log);
    fs::remove_all(scratch);
  }
  result["cost"] = {{"loop_s", summary.elapsed_s}, {"whole_s", since(begin)}};
  return result;
}

}  // namespace multipanda
