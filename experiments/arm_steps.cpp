#include "experiments/arm_steps.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include <fmt/format.h>

#include "arm_interface/arm_settings.hpp"
#include "common/machine.hpp"
#include "core/state/arm_state.hpp"
#include "experiments/motion_extent.hpp"
#include "experiments/on_arms.hpp"
#include "runtime/motion/joint_move.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

// Slower and softer than the bounds for arms beside people.
constexpr ContactBounds kStartBounds{
    .hand_speed = ArmSteps::kStartHandSpeed, .spring_force = 30, .spring_moment = 7.5};

constexpr double kUnderControl_s = 1;  // of loop time, until every arm is

std::string mounted_text(const Scene& scene) {
  std::string text;
  for (const auto& arm : scene.arms) text += "\n  " + describe_arm(arm);
  return text;
}

std::string bounds_text(const Scene& scene) {
  std::string text;
  for (const auto& lifted : scene.lifted) text += "\n  lifted: " + lifted;
  for (const auto& arm : scene.arms) {
    for (const auto& loosened : arm.loosened)
      text += fmt::format("\n  arm '{}', looser than the manufacturer's: {}", arm.name, loosened);
  }
  for (const auto& law : scene.unsafer_laws) text += "\n  removes a safeguard: " + law;
  if (scene.lifted.empty() && scene.unsafer_laws.empty())
    return text + " the defaults for arms beside people.";
  return text + "\n  With these bounds an arm can injure: keep everybody out of reach during a run.";
}

std::string modes_of(const RunStatus& status, std::size_t arm) {
  return fmt::format("arm '{}' is in mode {}{}", status.arms[arm].arm, to_string(status.arms[arm].mode),
                     status.arms[arm].errors.empty() ? "" : " (" + status.arms[arm].errors + ")");
}

std::string in_hold(const std::string& arm, ArmMode mode) {
  return mode == ArmMode::move ? fmt::format("arm '{}' was put into hold", arm)
                               : fmt::format("arm '{}' is in mode {}", arm, to_string(mode));
}

}  // namespace

std::string stopped_arm(const RunStatus& status, std::vector<bool>& moved) {
  moved.resize(status.arms.size());
  for (std::size_t i = 0; i < status.arms.size(); ++i) {
    const bool moves = status.arms[i].mode == ArmMode::move;
    if (moved[i] && !moves) return modes_of(status, i);
    moved[i] = moved[i] || moves;
    if (!moved[i] && status.time_s > kUnderControl_s) return modes_of(status, i);
  }
  return {};
}

ArmWatch::ArmWatch(const Scene& scene, const RecordLayout& layout,
                   const std::vector<std::shared_ptr<const ArmModel>>& models,
                   nlohmann::ordered_json expected)
    : expected_(std::move(expected)), extent_(scene, models) {
  if (!expected_.is_array() || expected_.size() != scene.arms.size())
    throw ExperimentInterrupted("the motion of the arms in simulation is unknown; begin a new experiment");
  for (const auto& arm : scene.arms) {
    const auto hold = std::ranges::find(layout.instances, arm.name + "_hold", &RecordLayout::Instance::name);
    arms_.push_back({.name = arm.name,
                     .start = arm.q_start,
                     .hold = static_cast<std::size_t>(hold - layout.instances.begin())});
  }
  // All arms go to hold at the end of a run, and on purpose from the first event that activates a hold.
  const auto holds_on_purpose = [](const TimelineEvent& event) {
    return event.what == TimelineEvent::What::stop || event.only || !event.deactivate.empty() ||
           std::ranges::any_of(event.activate, [](const auto& name) { return name.ends_with("_hold"); });
  };
  end_s_ = scene.duration_s > 0 ? scene.duration_s - 0.01 : std::numeric_limits<double>::infinity();
  for (const auto& event : scene.timeline) {
    if (holds_on_purpose(event)) end_s_ = std::min(end_s_, event.at_s - 0.01);
  }
}

std::string ArmWatch::look(const CycleRecord& record) {
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    const ArmSample& sample = record.arms[i];
    if (sample.sequence == 0) continue;
    if (!arm.seen) {  // the timeline has moved nothing yet
      arm.seen = true;
      for (Eigen::Index j = 0; j < arm.start.size(); ++j) {
        if (std::abs(sample.q[static_cast<std::size_t>(j)] - arm.start[j]) > ArmSteps::kStartError)
          return fmt::format("arm '{}' was too far from its start; was it moved?", arm.name);
      }
    }
    const bool holds = sample.owner == arm.hold;
    // For example after states that are too old: the other arms would continue their timeline.
    if (holds && arm.controlled && record.t.seconds() < end_s_)
      return in_hold(arm.name, static_cast<ArmMode>(sample.mode));
    arm.controlled = arm.controlled || !holds;
  }
  const std::string where = extent_.beyond(expected_);
  return where.empty() ? where : where + "; is an object missing?";
}

void ArmWatch::take(const CycleRecord& record) {
  extent_.take(record);
  if (found_ || (what_ = look(record)).empty()) return;
  found_ = true;
}

std::string ArmWatch::trouble(const RunStatus& status) {
  if (found_) return what_;
  const std::string stopped = stopped_arm(status, moved_);  // first: it may explain the loop's refusal
  return stopped.empty() ? status.refusal : stopped;
}

bool RunWatch::stopped(Session& session) {
  if (arms && trouble.empty() && !(trouble = arms->trouble(session.status())).empty()) session.stop();
  return !trouble.empty();
}

void RunWatch::check(const std::string& run, const RunSummary& summary) const {
  if (trouble.empty()) return;
  std::string why = run + ": " + trouble;
  for (const auto& fault : summary.faults()) why += "; " + fault;
  throw ExperimentInterrupted(why);
}

void ArmSteps::say(const std::string& text) const {
  if (progress_.line) progress_.line(text);
}

void ArmSteps::ask(const std::string& key, const std::string& text,
                   const std::function<bool()>& withdrawn) const {
  options_.person->meanwhile([&] {
    if (progress_.stopped() || (withdrawn && withdrawn())) throw Person::Ended("withdrawn: " + key);
  });
  try {
    options_.person->ready(key, text);
  } catch (const Person::Ended& ended) {
    throw ExperimentInterrupted(ended.what());
  }
}

void ArmSteps::check_list(const Scene& scene, std::size_t runs, double seconds) {
  say(fmt::format("\nCheck-list of {} on arms: {} run{} of {:.0f} s in total. Nothing has moved yet.",
                  experiment_.name, runs, runs == 1 ? "" : "s", seconds));
  const bool physical = std::ranges::any_of(
      scene.arms, [](const SceneArm& arm) { return arm.fci && !is_on_this_computer(arm.fci->address); });
  mounted_ = mounted_text(scene);
  ask("mounted", "1. Equipment and settings in each arm's web interface are exactly these:" + mounted_);
  const auto objects = objects_to_place(scene);
  std::string text =
      "2. Nobody and nothing is within reach of the arms. Place objects of the scene later, when asked:";
  for (const auto& object : objects) text += fmt::format(" {}", object.name);
  ask("clear", objects.empty() ? text.substr(0, text.find(" Objects")) : text);
  ask("user-stop",
      "3. A person who watches the arms holds the user stop. Press it before anybody reaches in: between two "
      "runs the arms are held under control, and only the button keeps them from moving.");
  bounds_ = bounds_text(scene);
  ask("bounds", "4. These bounds of the scene are accepted:" + bounds_);
  if (physical)
    ask("tried",
        "5. This scene has run in simulation and on virtual arms, and once on these arms with "
        "`multipanda run SCENE --backend fci --reduced`.");
}

// The check-list describes the first run; another variant may have other tools, thresholds or bounds.
void ArmSteps::confirm_set_up(const Scene& scene, const std::string& what) {
  if (const std::string mounted = mounted_text(scene); mounted != mounted_) {
    ask("mounted",
        fmt::format("{}: equipment or settings differ from the run before; they are now exactly these:{}",
                    what, mounted));
    mounted_ = mounted;
  }
  if (const std::string bounds = bounds_text(scene); bounds != bounds_) {
    ask("bounds",
        fmt::format("{}: the bounds differ from the run before; these are accepted:{}", what, bounds));
    bounds_ = bounds;
  }
}

void ArmSteps::before_run(const Scene& scene, const std::string& what, double seconds,
                          const nlohmann::ordered_json& extent) {
  confirm_set_up(scene, what);
  const auto objects = objects_to_place(scene);
  std::string all, names;
  for (const auto& object : objects) {
    all += object.text + '\n';
    names += (names.empty() ? "" : ", ") + object.name;
  }
  // A free object is no longer at its place: an arm has pushed it, or holds it.
  const bool changed = all != placed_ || std::ranges::any_of(scene.objects, [](const SceneObject& object) {
                         return !object.fixed;
                       });
  if (changed && cleared_ && !placed_.empty())
    ask("remove", fmt::format("{}: the objects are placed again. Press the user stop, remove all placed "
                              "objects, and release the user stop; the arms go to their start first.",
                              what));
  to_start(scene, changed || !cleared_, kNear);
  cleared_ = true;
  if (changed) {
    for (const auto& object : objects)
      ask("place " + object.name,
          fmt::format("Place, with the user stop pressed, and release it again:\n  {}", object.text));
    placed_ = all;
    // With the user stop pressed an arm can be moved by hand.
    if (!objects.empty()) to_start(scene, false, JointMove::kTolerance_rad);
  }
  ask("run", fmt::format("Run {}: {:.1f} s. In simulation it moved:\n{}\n  Expected objects: {}. Confirm "
                         "that nobody is within reach, and that the user stop is released and in your hand.",
                         what, seconds, describe_extent(extent), names.empty() ? "none" : names));
}

// In a session of its own. Until the answer, the arms are held under control.
void ArmSteps::to_start(const Scene& given, bool cleared, double near) {
  Scene scene = given;
  scene.controllets.clear();
  scene.active.clear();
  scene.timeline.clear();
  scene.objects.clear();
  scene.lifted.clear();
  scene.duration_s = 0;
  scene.contact_bounds = kStartBounds;
  std::vector<JointMove> moves;
  std::string unseen;
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    SceneArm& arm = scene.arms[i];
    moves.push_back(add_joint_move(scene, i, arm.q_start));
    const auto model = build_arm_model(arm);
    // Against other arms and the arm itself. Without shapes the feature could not be enabled.
    if (!model->self_pairs().empty())
      scene.controllets.back().features = {"collision_avoidance"};
    else
      unseen += fmt::format(
          "\n  Arm '{}' has no collision shapes: its path is not checked; make sure that it is free.",
          arm.name);
    arm.collision = careful_thresholds(*model, arm.collision);
    if (arm.fci) arm.fci->keep_collision_thresholds = false;
  }
  say("connecting to the arms; they hold their positions");
  MeasuredJoints measured(scene.arms.size());
  SessionOptions session_options{
      .paced = !options_.fast, .backend = backend_of(scene, options_.backend), .duration_s = 0.0};
  session_options.observer = [&measured](const CycleRecord& record) { measured.take(record); };
  Session session(scene, registry_, std::move(session_options));
  session.start();
  std::string trouble;
  std::vector<bool> moved;
  bool begun = false;
  const auto broken = [&] {
    const RunStatus status = session.status();
    if (trouble.empty()) trouble = stopped_arm(status, moved);
    for (std::size_t i = 0; begun && trouble.empty() && i < moves.size(); ++i) {
      // The others would reach unchecked positions.
      const ArmStatus& arm = status.arms[moves[i].arm];
      if (arm.controllet != move_controllet(scene.arms[moves[i].arm])) trouble = in_hold(arm.arm, arm.mode);
    }
    if (trouble.empty() && session.wait_for_end(0)) trouble = "the connection ended";
    return progress_.stopped() || !trouble.empty();
  };
  const auto end = [&] {
    session.stop();
    const RunStatus status = session.status();
    for (const auto& news : status.news) say("  " + news);
    return session.finish();
  };
  const auto interrupted = [&](const std::string& why) {
    (void)end();
    return ExperimentInterrupted("moving to the start: " + why);
  };
  if (!measured.wait_for_all(broken)) throw interrupted(trouble.empty() ? "stopped" : trouble);
  // An arm that was already in a reflex has not been seen moving.
  RunStatus status;
  for (const double t = measured.t() + 0.3; (status = session.status()).time_s < t && !broken();)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  if (status.arms.empty()) throw interrupted(trouble.empty() ? "stopped" : trouble);
  for (std::size_t i = 0; i < status.arms.size(); ++i) {
    if (status.arms[i].mode != ArmMode::move)
      throw interrupted(
          modes_of(status, i) + "; remove the cause, make sure that nobody is in its way, and clear it: " +
          "multipanda run SCENE --backend fci, and multipanda ctl recover " + status.arms[i].arm);
  }
  begun = true;
  double longest = kStartLeast_s;
  bool needed = false;
  for (auto& move : moves) {
    move.plan(measured.q(move), kStartSpeed, scene.arms[move.arm], kStartHandSpeed);
    longest = std::max(longest, move.duration_s);
    needed = needed || move.largest_way() > near;
  }
  if (needed) {
    std::string text = fmt::format("{} to the start, {:.1f} s, straight in joint space:",
                                   moves.size() == 1 ? "The arm moves" : "The arms move together", longest);
    for (auto& move : moves) {
      move.duration_s = longest;
      text += fmt::format(
          "\n  arm '{}': joints by up to {:.3f} rad at up to {:.2f} rad/s, the hand at up to {:.2f} m/s",
          scene.arms[move.arm].name, move.largest_way(), move.joint_speed(), move.hand_speed());
    }
    const PathClearance clearance = path_clearance(given, moves, !cleared);
    if (clearance.blocked(kMargin))
      throw interrupted(
          fmt::format("on the straight path the distance of {} falls to {:.3f} m; at least {:.2f} m are "
                      "expected. Guide the arms by hand nearer to their start",
                      clearance.pair, clearance.least, kMargin));
    try {
      if (options_.resume && !cleared)
        text += "\n  Objects of the interrupted experiment may still be there: remove them first.";
      ask("to-start", text + unseen + "\n  Keep the path free: the arms do not detect obstacles.", broken);
    } catch (const ExperimentInterrupted& refused) {
      throw interrupted(trouble.empty() ? refused.what() : trouble);
    }
    for (const auto& move : moves) {
      Request request{.kind = Request::Kind::set_target,
                      .instance = session.modes().find(move_controllet(scene.arms[move.arm]))};
      request.target.size = static_cast<std::uint8_t>(move.goal.size());
      std::copy(move.goal.begin(), move.goal.end(), request.target.values.begin());
      request.target.duration_s = move.duration_s;
      if (const Answer answer = session.modes().ask(request); !answer.accepted())
        throw interrupted(
            fmt::format("arm '{}' does not move: {}", scene.arms[move.arm].name, to_string(answer.verdict)));
    }
    if (!measured.wait_until(measured.t() + longest + JointMove::kSettle_s, broken))
      throw interrupted(trouble.empty() ? "stopped" : trouble);
  }
  const RunSummary summary = end();
  if (const auto faults = summary.faults(); !faults.empty())
    throw ExperimentInterrupted("moving to the start: " + faults.front());
  for (const auto& move : moves) {
    const double error = (move.goal - measured.q(move)).cwiseAbs().maxCoeff();
    if (error > JointMove::kTolerance_rad)
      throw ExperimentInterrupted(
          fmt::format("arm '{}' did not reach its start: a joint is {:.3f} rad off, at most "
                      "{:g} rad are expected. Is something in its way?",
                      scene.arms[move.arm].name, error, JointMove::kTolerance_rad));
  }
}

}  // namespace multipanda
