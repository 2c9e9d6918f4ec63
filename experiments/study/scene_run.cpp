#include "experiments/study/scene_run.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "common/text.hpp"
#include "core/model/model_terms.hpp"
#include "models/robot_description.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/hidden_plant.hpp"
#include "scene/rewrite.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda {
namespace {

double norm3(const std::array<double, 6>& wrench) { return std::hypot(wrench[0], wrench[1], wrench[2]); }

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

// Runs of one process share these libraries.
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
                                ": expected a duration: 'seconds' of the study, or the scene's duration_s");
  if (run.hidden) hide(scene, run.seed);
  return scene;
}

// Final pose of each arm's flange in the world, which depends on the joints alone.
void add_flanges(const Session& session, Json& figures) {
  for (std::size_t i = 0; i < session.layout().arms.size(); ++i) {
    const std::string& name = session.layout().arms[i].name;
    const auto q = figures[name + "/q_end_rad"].get<std::vector<double>>();
    if (q.empty()) continue;  // no cycle at all
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

// FNV-1a (Fowler, Noll, Vo) over the bytes of the numbers: equal digests mean identical runs, except with a
// probability of 2^-64.
void RunFigures::digest(const double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, values + i, sizeof(bits));
    for (int byte = 0; byte < 8; ++byte) {
      digest_ = (digest_ ^ (bits >> (8 * byte) & 0xff)) * 0x100000001b3ULL;
    }
  }
}

void RunFigures::take_arm(const ArmSample& sample, std::size_t joints, Arm& arm) {
  for (std::size_t j = 0; j < joints; ++j) {
    arm.speed = std::max(arm.speed, std::abs(sample.dq[j]));
    arm.torque = std::max(arm.torque, std::abs(sample.tau_cmd[j]));
    arm.torque_squares += sample.tau_cmd[j] * sample.tau_cmd[j];
  }
  if (sample.has_contact_truth) {
    arm.has_force = true;
    arm.force = std::max(arm.force, norm3(sample.F_K_W_true));
    arm.force_sum += norm3(sample.F_K_W_true);
  }
  if (sample.has_wrench_estimate) {
    arm.has_estimate = true;
    arm.estimate = std::max(arm.estimate, norm3(sample.F_K_W_est));
  }
  arm.interventions = sample.interventions;
  arm.q.assign(sample.q.begin(), sample.q.begin() + static_cast<std::ptrdiff_t>(joints));
  digest(sample.q.data(), joints);
  digest(sample.dq.data(), joints);
  digest(sample.tau_cmd.data(), joints);
}

void RunFigures::take(const CycleRecord& record) {
  ++cycles_;
  t_s_ = record.t.seconds();
  for (std::size_t i = 0; i < arms_.size(); ++i)
    take_arm(record.arms[i], layout_.arms[i].joint_count, arms_[i]);
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    for (std::size_t k = 0; k < outputs_[i].size(); ++k) {
      const auto& spec = layout_.instances[i].outputs[k];
      const double value = record.outputs[spec.offset];
      if (spec.size != 1 || std::isnan(value)) continue;
      Output& output = outputs_[i][k];
      output.low = output.cycles == 0 ? value : std::min(output.low, value);
      output.high = output.cycles == 0 ? value : std::max(output.high, value);
      output.last = value;
      ++output.cycles;
    }
  }
}

nlohmann::ordered_json RunFigures::json() const {
  nlohmann::ordered_json json{{"cycles", cycles_}, {"time_s", t_s_}};
  const auto cycles = static_cast<double>(std::max<std::uint64_t>(cycles_, 1));
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    const Arm& arm = arms_[i];
    const std::string name = layout_.arms[i].name + "/";
    const auto joints = static_cast<double>(layout_.arms[i].joint_count);
    json[name + "speed_max_rad_per_s"] = arm.speed;
    json[name + "torque_max_nm"] = arm.torque;
    json[name + "torque_rms_nm"] = std::sqrt(arm.torque_squares / (cycles * joints));
    if (arm.has_force) {
      json[name + "force_max_n"] = arm.force;
      json[name + "force_mean_n"] = arm.force_sum / cycles;
    }
    if (arm.has_estimate) json[name + "force_est_max_n"] = arm.estimate;
    json[name + "interventions"] = arm.interventions;
    json[name + "q_end_rad"] = arm.q;
  }
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    for (std::size_t k = 0; k < outputs_[i].size(); ++k) {
      const Output& output = outputs_[i][k];
      // A feature that is off has outputs of 0.
      if (output.cycles == 0 || (output.low == 0 && output.high == 0)) continue;
      const auto& instance = layout_.instances[i];
      const std::string name = instance.name + "/" + instance.outputs[k].name;
      json[name + "/min"] = output.low;
      json[name + "/max"] = output.high;
      json[name + "/end"] = output.last;
    }
  }
  json["digest"] = fmt::format("{:016x}", digest_);
  return json;
}

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
  options.thread.lock_memory = false;  // takes 8 ms, and matters for the wall clock only
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
