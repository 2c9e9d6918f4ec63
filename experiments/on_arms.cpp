#include "experiments/on_arms.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "arm_interface/arm_settings.hpp"
#include "common/text.hpp"
#include "experiments/task_runs.hpp"
#include "logs/export.hpp"
#include "logs/mcap_reader.hpp"
#include "scene/build.hpp"

namespace multipanda {

namespace {

// To three digits, and never "-0.000".
double rounded(double value) { return std::round(value * 1e3) * 1e-3 + 0.0; }

std::string point_text(const Vector3& p) {
  return fmt::format("({:.3f}, {:.3f}, {:.3f}) m", rounded(p.x()), rounded(p.y()), rounded(p.z()));
}

std::string pose_text(const Pose& X) {
  const Matrix3& R = X.rotation;
  const double roll = std::atan2(R(2, 1), R(2, 2)), pitch = std::asin(std::clamp(-R(2, 0), -1.0, 1.0)),
               yaw = std::atan2(R(1, 0), R(0, 0));
  std::string text = point_text(X.position);
  if (std::max({std::abs(roll), std::abs(pitch), std::abs(yaw)}) > 1e-4)
    text += fmt::format(", turned by roll {:.3f}, pitch {:.3f}, yaw {:.3f} rad", rounded(roll),
                        rounded(pitch), rounded(yaw));
  return text;
}

std::string shape_of(const SceneObject& object) {
  const Vector3& size = object.size;
  switch (object.shape) {
    case ShapeType::box:
      return fmt::format("box of {:g} x {:g} x {:g} m", size.x(), size.y(), size.z());
    case ShapeType::sphere:
      return fmt::format("sphere of {:g} m diameter", size.x());
    case ShapeType::cylinder:
      return fmt::format("cylinder of {:g} m diameter, {:g} m long", size.x(), size.z());
    case ShapeType::capsule:
      return fmt::format("capsule of {:g} m diameter, {:g} m long", size.x(), size.z());
    case ShapeType::plane:
      break;
  }
  return "plane";
}

std::string list_of(const JointVector& values) {
  std::vector<double> list(values.begin(), values.end());
  return fmt::format("{:g}", fmt::join(list, ", "));
}

}  // namespace

Experiment for_arms(Experiment experiment, std::vector<std::string>& left_out) {
  const auto& plants = experiment.plants;
  const std::string simulated =
      std::find(plants.begin(), plants.end(), "realistic") != plants.end() ? "realistic" : plants.back();
  experiment.plants = {simulated, kMeasured};
  for (auto& limit : experiment.limits) {
    for (auto* bounds : {&limit.at_most, &limit.at_least}) {
      if (const auto found = bounds->find(simulated); found != bounds->end())
        (*bounds)[kMeasured] = found->second;
    }
  }
  for (auto& change : experiment.vary) {
    if (!change.key.starts_with("arms.") || change.key.find(".start_rad") == std::string::npos)
      change.by = 0;  // still drawn, so that all repeats have the same starts
  }
  std::erase_if(experiment.variants, [&](const ExperimentVariant& variant) {
    const bool plant = std::any_of(variant.set.begin(), variant.set.end(), [](const Override& change) {
      return change.key == "plant" || change.key.starts_with("plant.");
    });
    if (plant) left_out.push_back(variant.name);
    return plant;
  });
  if (experiment.variants.empty())
    throw std::invalid_argument(experiment.name +
                                ": every variant changes the simulated plant; none can run on arms");
  return experiment;
}

BackendOptions backend_of(const Scene& scene, const BackendOptions& options) {
  for (const auto& arm : scene.arms) {
    if (!arm.fci ||
        std::ranges::any_of(options.addresses, [&](const auto& each) { return each.first == arm.name; }))
      continue;
    throw std::invalid_argument(
        fmt::format("arm '{0}' has the address {1} in its scene, but no --address; add --address {0}={1} to "
                    "confirm which arms move",
                    arm.name, arm.fci->address));
  }
  BackendOptions backend = options;
  std::erase_if(backend.addresses, [&](const auto& address) {
    return std::ranges::none_of(scene.arms, [&](const SceneArm& arm) { return arm.name == address.first; });
  });
  backend.kind = backend.addresses.size() == scene.arms.size() ? BackendKind::fci : BackendKind::as_scene;
  return backend;
}

void check_addresses_of_all(const Scene& scene, const BackendOptions& options) {
  for (const auto& arm : scene.arms) {
    if (std::ranges::any_of(options.addresses, [&](const auto& each) { return each.first == arm.name; }))
      continue;
    throw std::invalid_argument(fmt::format("arm '{0}' has no address; add --address {0}=ADDRESS", arm.name));
  }
}

void check_no_recovery(const Scene& scene) {
  for (const auto& arm : scene.arms) {
    if (!arm.fci || !arm.fci->recover_at_start) continue;
    throw std::invalid_argument(
        fmt::format("arm '{}': 'recover_at_start' would clear a reflex without asking, although the arm may "
                    "have stopped at a person; remove it from the scene",
                    arm.name));
  }
}

void check_for_arms(const Scene& scene, const std::string& variant) {
  check_no_recovery(scene);
  for (const auto& event : scene.timeline) {
    if (event.what != TimelineEvent::What::place) continue;
    throw std::invalid_argument(
        fmt::format("variant '{}': the timeline places the object '{}' at {:g} s, which only a simulation "
                    "can do; run this experiment on simulated arms",
                    variant, event.object, event.at_s));
  }
}

std::vector<PlacedObject> objects_to_place(const Scene& scene) {
  std::vector<PlacedObject> list;
  for (const auto& object : scene.objects) {
    if (object.shape == ShapeType::plane) continue;
    std::string text = fmt::format("{}: {}, {}", object.name, shape_of(object),
                                   object.fixed ? "fixed" : fmt::format("free, {:g} kg", object.mass));
    text += fmt::format(", friction {:g}", object.friction);
    if (object.contact)
      text += fmt::format(", surface of {:g} kN/m", object.contact->stiffness_n_per_m * 1e-3);
    for (const auto& arm : scene.arms) {
      const Pose X_BO = arm.X_WB.inverse() * object.X_WO;
      text += fmt::format("\n    its center at {} in the base frame of arm '{}'", pose_text(X_BO), arm.name);
      if (object.shape == ShapeType::box && X_BO.rotation.isApprox(Matrix3::Identity(), 1e-4))
        text += fmt::format(" (upper face at z = {:.3f} m)", X_BO.position.z() + object.size.z() / 2);
    }
    list.push_back({.name = object.name, .text = text});
  }
  return list;
}

std::string describe_arm(const SceneArm& arm) {
  std::string text =
      fmt::format("arm '{}' at {}: {}, {}", arm.name, arm.fci ? arm.fci->address : "(simulated)", arm.model,
                  arm.hand ? "with its hand" : "without hand");
  if (arm.tool.mass > 0)
    text += fmt::format(", a tool of {:g} kg with its center of mass at {} in the flange", arm.tool.mass,
                        point_text(arm.tool.p_FC));
  if (arm.load_declared.mass > 0)
    text += fmt::format(", a payload of {:g} kg with its center of mass at {} in the flange",
                        arm.load_declared.mass, point_text(arm.load_declared.p_FC));
  text += fmt::format("\n    end effector at {} in the flange", pose_text(arm_config(arm).frames.X_FE));
  const bool kept = !arm.collision && arm.fci && arm.fci->keep_collision_thresholds;
  if (kept) return text + "\n    it keeps the thresholds set by an earlier program";
  const auto limits = arm.collision.value_or(careful_thresholds(*build_arm_model(arm)));
  std::vector<double> wrench(limits.nominal.wrench_upper.begin(), limits.nominal.wrench_upper.end());
  return text + fmt::format("\n    stops itself above [{:g}] N, N m at K and [{}] N m at the joints ({})",
                            fmt::join(wrench, ", "), list_of(limits.nominal.torque_upper),
                            arm.collision ? "'collision' of the scene" : "the default of arms");
}

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// The scene as stored in the log; empty if the log has none.
std::string scene_in(const fs::path& log) {
  McapReader reader(log);
  (void)reader.next();  // attachments precede the first message
  for (const auto& attachment : reader.attachments()) {
    if (attachment.name == "scene.yaml") return attachment.data;
  }
  return {};
}

// "measured_k10_2.mcap": variant and repeat.
bool split_name(const std::string& stem, std::string& variant, std::size_t& repeat) {
  const std::string head = std::string(kMeasured) + "_";
  const auto last = stem.rfind('_');
  if (!stem.starts_with(head) || last <= head.size()) return false;
  variant = stem.substr(head.size(), last - head.size());
  const char* end = stem.data() + stem.size();
  return std::from_chars(stem.data() + last + 1, end, repeat).ptr == end;
}

void add_folder(const fs::path& folder, const std::vector<const ExperimentVariant*>& variants,
                std::vector<BesideLog>& logs) {
  const std::size_t before = logs.size();
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::string name;
    std::size_t repeat = 0;
    if (entry.path().extension() != ".mcap" || !split_name(entry.path().stem().string(), name, repeat))
      continue;
    const auto variant = std::ranges::find_if(variants, [&](const auto* each) { return each->name == name; });
    if (variant != variants.end()) logs.push_back({*variant, repeat, entry.path()});
  }
  if (logs.size() == before)
    throw std::invalid_argument(
        fmt::format("--beside {}: it has no log of a variant of this run, such as {}_{}_1.mcap",
                    folder.string(), kMeasured, variants.front()->name));
}

// "CA-MA_2.npz": CA-MA; empty: not such a name.
std::string condition_of(const fs::path& file) {
  const std::string stem = file.stem().string();
  const auto last = stem.rfind('_');
  if (file.extension() != ".npz" || last == std::string::npos || last + 1 == stem.size() ||
      stem.find_first_not_of("0123456789", last + 1) != std::string::npos)
    return {};
  return stem.substr(0, last);
}

// The directory at the end of the zip archive lists its entries. The page reads and checks them; this finds a
// wrong file before the conditions run.
void check_file(const std::string& said, const fs::path& file) {
  constexpr std::streamoff kDirectory = 1 << 16;
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in || !fs::is_regular_file(file))
    throw std::invalid_argument(fmt::format("--beside {}: there is no file {}", said, file.string()));
  in.seekg(std::max<std::streamoff>(in.tellg() - std::streamoff{kDirectory}, 0));
  const std::string end{std::istreambuf_iterator<char>(in), {}};
  if (end.find("about.npy") == std::string::npos || end.find("stages_us.npy") == std::string::npos)
    throw std::invalid_argument(
        fmt::format("--beside {}: {} is not a measurement by the multimode controller (docs/ros2_control.md)",
                    said, file.string()));
}

}  // namespace

std::vector<BesideLog> beside_logs(const std::vector<std::string>& named,
                                   const std::vector<const ExperimentVariant*>& variants) {
  std::vector<std::string> names;
  for (const auto* variant : variants) names.push_back(variant->name);
  std::vector<BesideLog> logs;
  for (const auto& text : named) {
    const auto equals = text.find('=');
    const auto variant = std::ranges::find(names, text.substr(0, equals));
    const bool says = equals != std::string::npos && !fs::exists(text);
    if (says && variant == names.end())
      throw std::invalid_argument(fmt::format("--beside {}: there is no variant '{}'{}", text,
                                              text.substr(0, equals),
                                              name_hint(text.substr(0, equals), names, "there are none")));
    fs::path path = says ? text.substr(equals + 1) : text;
    if (!says && fs::is_directory(path / "logs")) {
      add_folder(path / "logs", variants, logs);
      continue;
    }
    if (fs::is_directory(path)) path /= "log.mcap";
    if (!fs::is_regular_file(path))
      throw std::invalid_argument(fmt::format("--beside {}: there is no log {}", text, path.string()));
    if (!says && variants.size() != 1)
      throw std::invalid_argument(
          fmt::format("--beside {}: {} variants run; name the one of this log: --beside {}={}", text,
                      variants.size(), names.front(), text));
    logs.push_back(
        {says ? variants[static_cast<std::size_t>(variant - names.begin())] : variants.front(), 1, path});
  }
  for (std::size_t i = 0; i < logs.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (logs[i].variant == logs[k].variant && logs[i].repeat == logs[k].repeat)
        throw std::invalid_argument(fmt::format("--beside: two logs of variant '{}', repeat {}",
                                                logs[i].variant->name, logs[i].repeat));
    }
  }
  return logs;
}

Json beside_run(const BesideLog& log, const Json& like, const fs::path& folder) {
  const std::string name = fmt::format("{}_{}_{}", kMeasured, log.variant->name, log.repeat);
  const fs::path arrays = folder / "data" / (name + ".npz");
  (void)export_npz(log.log, arrays);
  const std::string scene = scene_in(log.log);
  Json run = like;
  run["name"] = name;
  run["plant"] = kMeasured;
  run["repeat"] = log.repeat;
  run["seed"] = 0;
  run["log"] = fs::absolute(log.log).lexically_relative(fs::absolute(folder)).string();
  run["npz"] = fs::relative(arrays, folder).string();
  run.erase("objects");
  run["faults"] = Json::array();
  run["interventions"] = Json::array();
  if (!scene.empty()) {
    run["scene_text"] = scene;
    run["timeline"] = timeline_of(scene);
  }
  return run;
}

std::vector<BesideTrace> beside_traces(const std::vector<std::string>& named,
                                       const std::vector<std::string>& conditions) {
  std::vector<BesideTrace> traces;
  const auto runs = [&](const std::string& name) {
    return std::ranges::find(conditions, name) != conditions.end();
  };
  const auto add = [&](const std::string& said, const std::string& condition, const fs::path& file) {
    check_file(said, file);
    traces.push_back({condition, fs::absolute(file)});
  };
  for (const auto& text : named) {
    const auto equals = text.find('=');
    const bool says = equals != std::string::npos && !fs::exists(text);
    const fs::path path = says ? text.substr(equals + 1) : text;
    if (!says && fs::is_directory(path)) {
      std::vector<fs::path> files;
      for (const auto& entry : fs::directory_iterator(path))
        if (runs(condition_of(entry.path()))) files.push_back(entry.path());
      if (files.empty())
        throw std::invalid_argument(
            fmt::format("--beside {}: it has no file of a condition of this run, such as {}_1.npz", text,
                        conditions.front()));
      std::ranges::sort(files);
      for (const auto& file : files) add(text, condition_of(file), file);
      continue;
    }
    const std::string condition = says ? text.substr(0, equals) : condition_of(path);
    if (condition.empty())
      throw std::invalid_argument(fmt::format(
          "--beside {}: its condition is unknown; name it: --beside {}={}", text, conditions.front(), text));
    if (!runs(condition))
      throw std::invalid_argument(fmt::format("--beside {}: there is no condition '{}'{}", text, condition,
                                              name_hint(condition, conditions, "there are none")));
    add(text, condition, path);
  }
  return traces;
}

}  // namespace multipanda
