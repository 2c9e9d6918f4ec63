#include "commission/tour.hpp"

#include <algorithm>
#include <ctime>
#include <fstream>
#include <stdexcept>

#include <fmt/format.h>

#include "commission/measures.hpp"
#include "common/machine.hpp"
#include "report/page_script.hpp"

namespace multipanda::commission {
namespace {

std::string time_text() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  const auto size = std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &parts);
  return {text, size};
}

std::string question(const Step& step, std::size_t number, std::size_t count) {
  return fmt::format("\n[{}/{}] {}\n  {}", number, count, step.title, step.about);
}

StepResult failed(const std::string& found, const std::string& remedy) {
  StepResult result;
  result.fail(found, "the step to end by itself, the arms in hold", remedy);
  return result;
}

}  // namespace

bool Context::virtual_arms() const {
  return std::all_of(setup.addresses.begin(), setup.addresses.end(), is_on_this_computer);
}

void Context::check_stopped() const {
  if (stopped && stopped()) throw Person::Ended("stopped on request");
}

StepResult each_arm(Context& context,
                    const std::function<void(ArmIndex, const std::string&, StepResult&)>& work) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count() && result.verdict != Verdict::no_go; ++i)
    work(i, context.arm(i).name, result);
  return result;
}

std::vector<Step> steps_of(const TourSetup& setup) {
  std::vector<Step> steps;
  add_steps_at_rest(steps, setup);
  add_steps_in_hold(steps, setup);
  add_steps_in_motion(steps, setup);
  if (setup.scene.arms.size() > 1) add_steps_between_arms(steps, setup);
  return steps;
}

Json new_state(const TourSetup& setup) {
  Json arms = Json::array();
  for (std::size_t i = 0; i < setup.scene.arms.size(); ++i) {
    arms.push_back({{"name", setup.scene.arms[i].name},
                    {"model", setup.scene.arms[i].model},
                    {"address", setup.addresses[i]}});
  }
  return {{"commission", 1}, {"scene", setup.scene_name}, {"scene_text", setup.scene.text},
          {"arms", arms},    {"begun", time_text()},      {"steps", Json::object()}};
}

void write_state(const std::filesystem::path& folder, const Json& state) {
  const auto file = folder / "commission.json", part = folder / "commission.json.part";
  {
    std::ofstream out(part);
    out << state.dump(1) << '\n';
    if (!out.flush())
      throw std::runtime_error("cannot write " + part.string() + ": check the free disk space");
  }
  std::filesystem::rename(part, file);  // a killed tour leaves the previous or this state
}

TourEnd run_tour(Context& context, Json state, const std::function<void(const Step&, const Json&)>& show) {
  const auto steps = steps_of(context.setup);
  TourEnd end;
  for (std::size_t k = 0; k < steps.size() && end.step.empty(); ++k) {
    const Step& step = steps[k];
    const Json* before = state["steps"].contains(step.id) ? &state["steps"][step.id] : nullptr;
    const bool done = before != nullptr && (*before)["verdict"] != "no-go";
    if (done && !step.every_time) continue;
    StepResult result;
    std::string ended;
    try {
      if (context.run) context.run->check();
      context.person.ready(step.id, question(step, k + 1, steps.size()));
      result = step.run(context);
      if (context.run) context.run->check();
    } catch (const Person::Ended& person) {
      ended = person.what();
    } catch (const ArmLeft& left) {
      result = failed(left.what(), "see docs/errors.md for the cause; free the arm, then resume the tour");
    } catch (const std::exception& error) {
      result = failed(error.what(), "remove the cause, then resume the tour");
    }
    if (ended.empty() && context.stopped && context.stopped()) ended = "stopped on request";
    // An exception may leave an arm compliant: hold it before anything is written.
    if (context.run && (!ended.empty() || result.verdict == Verdict::no_go)) context.run->halt();
    if (!ended.empty()) {
      end = {.verdict = Verdict::skipped, .step = step.id, .state = {}};
      context.say(ended + (context.run ? "; the arms are held" : "; no arm has moved"));
      break;
    }
    Json json = to_json(result);
    json["title"] = step.title;
    json["about"] = step.about;
    json["at"] = time_text();
    // Findings of an earlier tour are kept in a repeated step unless the step finds something new.
    if (!json.contains("measured") && before != nullptr && before->contains("measured"))
      json["measured"] = (*before)["measured"];
    state["steps"][step.id] = json;
    write_state(context.setup.folder, state);
    show(step, json);
    if (result.verdict == Verdict::no_go) end = {.verdict = Verdict::no_go, .step = step.id, .state = {}};
  }
  if (context.run) context.run->end();
  state["ended"] = {
      {"verdict", end.step.empty() ? "go" : to_string(end.verdict)}, {"step", end.step}, {"at", time_text()}};
  write_state(context.setup.folder, state);
  end.state = std::move(state);
  return end;
}

// One arm at a time, each from its start in the tour; other arms and objects of the scene are present.
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

std::filesystem::path make_page(const std::filesystem::path& folder) {
  PageScript("commission/commission_page.py", "the page of the tour")
      .run({(folder / "commission.json").string()});
  return folder / "commission.html";
}

}  // namespace multipanda::commission
