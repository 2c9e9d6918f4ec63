#include "commission/measures.hpp"
#include "commission/tour.hpp"

namespace multipanda::commission {

// One arm at a time, each from where its own tour began: other arms and objects of the scene stand by.
void measure_twin(const TourSetup& setup, const Registry& registry, Json& state) {
  const Json& steps = state["steps"];
  const auto done = [&](const char* step, const std::string& arm) {
    return steps.contains(step) && steps[step].contains("measured") && steps[step]["measured"].contains(arm);
  };
  Scene scene = setup.scene;
  for (auto& arm : scene.arms) {
    arm.fci.reset();
    if (!done("gravity", arm.name)) continue;
    const auto q = steps["gravity"]["measured"][arm.name]["q"].get<std::vector<double>>();
    arm.q_start = Eigen::Map<const Eigen::VectorXd>(q.data(), static_cast<Eigen::Index>(q.size()));
  }
  ArmsRun run(commission_scene(scene), registry, {.kind = BackendKind::mujoco}, false);
  run.start();
  Json twin = Json::object();
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    const std::string& name = scene.arms[i].name;
    Json& json = twin[name];
    json = Json::object();
    if (done("joint_motion", name)) {
      const auto figures = measure_joint_motion(run, i);
      json.update({{"joints", figures.curves},
                   {"friction_nm", list(figures.friction_nm)},
                   {"error_rad", list(figures.error_rad)}});
    }
    if (done("cartesian_motion", name)) {
      const auto figures = measure_cartesian_motion(run, i);
      json.update({{"hand", figures.curves}, {"error_m", figures.error_m}});
    }
    if (done("stop", name)) {
      const auto figures = measure_stop(run, i);
      json.update({{"stop_s", figures.time_s}, {"stop_rad", figures.angle_rad}});
    }
    if (done("delay", name)) json["torque_delay_s"] = measure_delay(run, i).torque_delay_s;
    if (done("noise", name)) {
      const auto figures = measure_noise(run, i, 2);
      json.update({{"noise_dq", list(figures.dq_rad_per_s)}, {"noise_tau", list(figures.tau_nm)}});
    }
  }
  run.end();
  state["twin"] = twin;
  state["twin_plant"] = scene.plant.name;
}

}  // namespace multipanda::commission
