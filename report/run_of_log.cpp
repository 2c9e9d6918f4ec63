#include "report/run_of_log.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>
#include <span>

#include "backends/mujoco/mujoco_backend.hpp"
#include "backends/mujoco/picture.hpp"
#include "common/text.hpp"
#include "logs/cdr.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

constexpr std::uint64_t kMomentEvery = 100;  // cycles

double seconds_of(const msg::Time& time) { return time.sec + 1e-9 * time.nanosec; }

void take_state(const msg::ArmState& state, const std::map<std::string, Pose>& objects, RunOfLog& run,
                std::map<std::string, double>& first_seen) {
  const double t = seconds_of(state.stamp);
  const bool first = first_seen.emplace(state.arm, t).second;
  if (!first && state.cycle % kMomentEvery != 0) return;
  // States of one cycle are consecutive; the first state of an arm may come later than that of another.
  if (run.moments.empty() || run.moments.back().t != t) run.moments.push_back({t, {}, objects});
  run.moments.back().q[state.arm] = state.q;
}

void rebuild_scene(RunOfLog& run, const std::vector<ControlletType>& controllets) {
  if (run.scene_text.empty()) {
    run.scene_missing = "the scene file is not in the log";
    return;
  }
  const auto path = run.run.find("scene_path");  // relative paths in the file start here
  const std::string name = path != run.run.end() ? path->second : "scene.yaml";
  try {
    Registry registry = build_registry(scene_plugins(run.scene_text, name));
    for (const auto& type : controllets) registry.add(type);
    run.scene = parse_scene(run.scene_text, name, registry);
  } catch (const std::exception& error) {
    run.scene_missing = std::string("the scene in the log cannot be rebuilt: ") + error.what();
  }
}

// qpos of the whole model: arms and objects as recorded, everything else as at the start.
std::vector<double> positions(const World& world, const Scene& scene, const RunOfLog::Moment& moment) {
  const mjData* data = world.data();
  std::vector<double> qpos(data->qpos, data->qpos + world.model()->nq);
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const auto recorded = moment.q.find(scene.arms[i].name);
    if (recorded == moment.q.end()) continue;
    const auto& places = world.arm(i).qpos;
    for (std::size_t k = 0; k < std::min(places.size(), recorded->second.size()); ++k)
      qpos[static_cast<std::size_t>(places[k])] = recorded->second[k];
  }
  for (const auto& object : world.objects()) {
    const auto recorded = moment.objects.find(object.name);
    if (recorded == moment.objects.end() || object.qpos < 0) continue;
    const std::array<double, 7> X_WO = recorded->second.values();
    std::copy(X_WO.begin(), X_WO.end(), qpos.begin() + object.qpos);
  }
  return qpos;
}

void draw(const RunOfLog& run, const std::vector<ChosenMoment>& chosen,
          const std::filesystem::path& directory, ScenePictures& out) {
  const Scene& scene = *run.scene;
  const MujocoBackend backend(scene, {.pace = Pace::unpaced, .looks = true});
  const World& world = backend.world();
  Painter painter(world.model());
  if (!painter.works()) {
    out.missing = painter.reason();
    return;
  }
  for (const ChosenMoment& c : chosen) {
    const std::filesystem::path file = directory / ("scene_" + std::to_string(out.pictures.size()) + ".png");
    out.missing = painter.paint(positions(world, scene, run.moments[c.moment]), file);
    if (!out.missing.empty()) return;
    out.pictures.push_back({file, c.caption});
  }
  const bool unknown = std::any_of(scene.objects.begin(), scene.objects.end(), [&](const SceneObject& o) {
    return !o.fixed && !run.moments.back().objects.contains(o.name);
  });
  if (unknown)
    out.note =
        "Free objects are drawn at their initial positions, because the log does not contain their motion.";
}

constexpr double kApart = 0.4;  // pictures closer in time than this look alike [s]

std::string at(double t, const std::string& what) {
  char text[48];
  (void)std::snprintf(text, sizeof(text), "t = %.1f s", t);
  return text + (what.empty() ? std::string() : ": " + what);
}

// The last moment not after t; the first one if there is none.
std::size_t moment_at(const RunOfLog& run, double t) {
  const auto after = std::upper_bound(run.moments.begin(), run.moments.end(), t,
                                      [](double time, const RunOfLog::Moment& m) { return time < m.t; });
  return after == run.moments.begin() ? 0 : static_cast<std::size_t>(after - run.moments.begin()) - 1;
}

}  // namespace

RunOfLog read_run(const std::filesystem::path& log, const std::vector<ControlletType>& controllets) {
  RunOfLog run;
  McapReader reader(log);
  std::map<std::string, double> first_seen;
  std::map<std::string, Pose> objects;
  while (const auto message = reader.next()) {
    if (holds<msg::ArmState>(*message->schema)) {
      take_state(from_cdr<msg::ArmState>(message->data), objects, run, first_seen);
    } else if (holds<msg::ObjectPose>(*message->schema)) {
      const auto seen = from_cdr<msg::ObjectPose>(message->data);
      const auto& [p, q] = seen.pose;
      objects[seen.object] = Pose::from({p.x, p.y, p.z}, Quaternion(q.w, q.x, q.y, q.z));
    } else if (holds<msg::Switch>(*message->schema)) {
      const auto change = from_cdr<msg::Switch>(message->data);
      if (change.accepted) run.switches.push_back({seconds_of(change.stamp), change.started});
    }
  }
  for (const auto& metadata : reader.metadata()) {
    if (metadata.name == "run") run.run = {metadata.values.begin(), metadata.values.end()};
    if (metadata.name == "missing")
      run.missing = std::map<std::string, std::string>(metadata.values.begin(), metadata.values.end());
  }
  for (const auto& attachment : reader.attachments()) {
    if (attachment.name == "scene.yaml") run.scene_text = attachment.data;
    if (attachment.name == "layout.json") run.layout = attachment.data;
  }
  rebuild_scene(run, controllets);
  return run;
}

ScenePictures draw_scene(const RunOfLog& run, std::size_t at_most, const std::filesystem::path& directory) {
  ScenePictures out;
  const auto chosen = choose_moments(run, at_most);
  if (!run.scene) {
    out.missing = run.scene_missing;
  } else if (chosen.empty()) {
    out.missing = "the log has no joint positions";
  } else {
    try {
      draw(run, chosen, directory, out);
    } catch (const std::exception& error) {
      out.missing = error.what();
    }
  }
  return out;
}

std::vector<ChosenMoment> choose_moments(const RunOfLog& run, std::size_t at_most) {
  std::vector<ChosenMoment> chosen;
  if (run.moments.empty() || at_most == 0) return chosen;
  const auto far_from_all = [&](std::size_t moment) {
    return std::none_of(chosen.begin(), chosen.end(), [&](const ChosenMoment& c) {
      return std::abs(run.moments[c.moment].t - run.moments[moment].t) < kApart;
    });
  };
  const double start = run.moments.front().t, end = run.moments.back().t;
  chosen.push_back({0, at(start, "start")});

  std::vector<RunOfLog::SwitchMoment> switches;
  for (const auto& change : run.switches) {
    if (change.t > start + kApart && (switches.empty() || change.t > switches.back().t + kApart))
      switches.push_back(change);
  }
  const std::size_t room = at_most - 1;
  const std::size_t shown = std::min(room, switches.size());
  for (std::size_t i = 0; i < shown; ++i) {  // spread evenly if there are too many
    const auto& change = switches[shown == switches.size() ? i : i * switches.size() / shown];
    const std::size_t moment = moment_at(run, change.t);
    if (far_from_all(moment)) chosen.push_back({moment, at(change.t, joined(change.started) + " starts")});
  }
  for (const auto& [t, what] : {std::pair(end, "end"), std::pair((start + end) / 2, "")}) {
    const std::size_t moment = moment_at(run, t);
    if (chosen.size() < at_most && far_from_all(moment)) chosen.push_back({moment, at(t, what)});
  }
  std::sort(chosen.begin(), chosen.end(),
            [](const ChosenMoment& a, const ChosenMoment& b) { return a.moment < b.moment; });
  return chosen;
}

}  // namespace multipanda
