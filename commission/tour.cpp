#include "commission/tour.hpp"

#include <algorithm>
#include <ctime>
#include <fstream>
#include <stdexcept>

#include <fmt/format.h>

#include "report/page_script.hpp"
#include "support/address.hpp"

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
  if (stopped && stopped()) throw Ended("stopped on request");
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
    if (!out.flush()) throw std::runtime_error("cannot write " + part.string() + ": is the disk full?");
  }
  std::filesystem::rename(part, file);  // a killed tour leaves the former state or this one
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
    } catch (const Ended& person) {
      ended = person.what();
    } catch (const ArmLeft& left) {
      result = failed(left.what(), "see docs/errors.md for the cause; free the arm, then resume the tour");
    } catch (const std::exception& error) {
      result = failed(error.what(), "remove the cause, then resume the tour");
    }
    if (ended.empty() && context.stopped && context.stopped()) ended = "stopped on request";
    // An exception may leave an arm soft: it is held before anything is written.
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
    // What an earlier tour found in a step that is repeated stays, as long as the step finds nothing new.
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

std::filesystem::path make_page(const std::filesystem::path& folder) {
  PageScript("commission/commission_page.py", "the page of the tour")
      .run({(folder / "commission.json").string()});
  return folder / "commission.html";
}

}  // namespace multipanda::commission
