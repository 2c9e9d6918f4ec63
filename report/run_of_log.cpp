#include "report/run_of_log.hpp"

#include "logs/cdr.hpp"
#include "logs/mcap_reader.hpp"
#include "logs/messages.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

constexpr std::uint64_t kMomentEvery = 100;  // cycles

double seconds_of(const msg::Time& time) { return time.sec + 1e-9 * time.nanosec; }

void take_state(const msg::ArmState& state, RunOfLog& run, std::map<std::string, double>& first_seen) {
  const double t = seconds_of(state.stamp);
  const bool first = first_seen.emplace(state.arm, t).second;
  if (!first && state.cycle % kMomentEvery != 0) return;
  // States of one cycle are consecutive; the first state of an arm may come later than that of another.
  if (run.moments.empty() || run.moments.back().t != t) run.moments.push_back({t, {}});
  run.moments.back().q[state.arm] = state.q;
}

void rebuild_scene(RunOfLog& run, const std::vector<ControlletType>& controllets) {
  if (run.scene_text.empty()) {
    run.scene_missing = "the scene file is not in the log";
    return;
  }
  const auto path = run.run.find("scene_path");  // relative paths in the file start there
  const std::string name = path != run.run.end() ? path->second : "scene.yaml";
  try {
    Registry registry = build_registry(scene_plugins(run.scene_text, name));
    for (const auto& type : controllets) registry.add(type);
    run.scene = parse_scene(run.scene_text, name, registry);
  } catch (const std::exception& error) {
    run.scene_missing = std::string("the scene in the log cannot be rebuilt: ") + error.what();
  }
}

}  // namespace

RunOfLog read_run(const std::filesystem::path& log, const std::vector<ControlletType>& controllets) {
  RunOfLog run;
  McapReader reader(log);
  std::map<std::string, double> first_seen;
  while (const auto message = reader.next()) {
    if (holds<msg::ArmState>(*message->schema)) {
      take_state(from_cdr<msg::ArmState>(message->data), run, first_seen);
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

}  // namespace multipanda
