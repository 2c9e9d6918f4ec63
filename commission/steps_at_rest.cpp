#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <thread>

#include <fmt/format.h>

#include "commission/fits.hpp"
#include "commission/limits.hpp"
#include "commission/tour.hpp"
#include "core/rt/thread_setup.hpp"
#include "core/types/statistics.hpp"
#include "doctor/arm_stream.hpp"
#include "doctor/examination.hpp"
#include "fci/client/arm_connection.hpp"
#include "fci/client/arm_packet.hpp"
#include "fci/client/fci_backend.hpp"
#include "fci/client/model_check.hpp"
#include "fci/wire/error_flags.hpp"
#include "models/robot_description.hpp"
#include "scene/build.hpp"

// Steps before torque control: they only read states and settings of the arms and cannot move them.
namespace multipanda::commission {
namespace {

using fci::ArmConnection;
using fci::RobotState;

std::unique_ptr<ArmConnection> connected(const Context& context, ArmIndex arm) {
  auto link = std::make_unique<ArmConnection>(
      fci::ArmConnectionOptions{.name = context.arm(arm).name, .address = context.setup.addresses[arm]});
  link->connect();
  return link;
}

JointVector vector_of(const std::array<double, 7>& values) {
  return Eigen::Map<const Eigen::Matrix<double, 7, 1>>(values.data());
}

double fastest_joint(const RobotState& state) {
  double fastest = 0;
  for (const double v : state.dq) fastest = std::max(fastest, std::abs(v));
  return fastest;
}

// Mean over `count` states of an arm at rest, and its fastest joint. An arm that was just touched or released
// may come to rest first.
struct Rest {
  RestSample mean{JointVector::Zero(7), JointVector::Zero(7)};
  double fastest = 0;  // [rad/s]
};

Rest rest_of(ArmConnection& link, int count) {
  constexpr int kLongest = 5000, kStill = 200;  // states
  for (int waited = 0, still = 0; waited < kLongest && still < kStill; ++waited)
    still = fastest_joint(link.next_state()) < kStillSpeed ? still + 1 : 0;
  Rest rest;
  for (int k = 0; k < count; ++k) {
    const RobotState& state = link.next_state();
    rest.mean.q += vector_of(state.q) / count;
    rest.mean.tau_J += vector_of(state.tau_J) / count;
    rest.fastest = std::max(rest.fastest, fastest_joint(state));
  }
  return rest;
}

std::string address_of(const Context& context, ArmIndex arm) {
  return fmt::format("arm '{}' at {}", context.arm(arm).name, context.setup.addresses[arm]);
}

// A bad finding ends the tour; for warnings the person decides with the next key.
void take(StepResult& result, const doctor::Finding& finding, const std::string& arm = {}) {
  for (const auto& figure : finding.figures) {
    if (figure.name != "p99" && figure.name != "lost" && figure.name != "version") continue;
    result.show(arm, finding.subject + ", " + figure.name, figure.value, figure.unit);
  }
  const std::string text = finding.subject + ": " + finding.measured;
  if (finding.judged == doctor::Judgment::bad)
    result.fail(text, "a computer that sustains 1 kHz", finding.cause + "; " + finding.cure);
  if (finding.judged == doctor::Judgment::warning)
    result.notes.push_back(text + ". " + finding.cause + ". " + finding.cure);
}

StepResult run_doctor(Context& context) {
  StepResult result;
  // Judged by the purpose that follows from the addresses, but measured without them: the network has its
  // own step.
  const auto findings = doctor::examine({.addresses = {},
                                         .scene = context.setup.scene_name,
                                         .seconds = context.setup.seconds,
                                         .purpose = doctor::purpose_of(context.setup.addresses)},
                                        [&](const doctor::Finding& finding) {
                                          context.check_stopped();
                                          context.say(fmt::format("  {:<8} {}: {}", to_string(finding.judged),
                                                                  finding.subject, finding.measured));
                                        });
  for (const auto& finding : findings) take(result, finding);
  return result;
}

StepResult run_network(Context& context) {
  StepResult result;
  const auto purpose = doctor::purpose_of(context.setup.addresses);
  const doctor::SystemFiles files;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    context.check_stopped();
    const std::string& address = context.setup.addresses[i];
    const std::string& name = context.arm(i).name;
    const auto card = doctor::read_network_card(address, files);
    take(result, doctor::judge_network_card(card, purpose), name);
    const auto round_trip = doctor::read_round_trip(address, context.setup.seconds);
    if (round_trip.us.empty())
      result.notes.push_back(address_of(context, i) + ": no echo; round trip not judged");
    if (auto us = round_trip.us; !us.empty()) {
      result.at_most(
          name, "round trip, p99", quantile(us, 0.99), "us",
          context.virtual_arms() ? kShown : kRoundTripP99_us,
          "connect the arm directly to a separate network card; see the doctor's line on timer wake-up");
    }
    const auto stream = doctor::read_arm_stream(address, context.setup.seconds);
    if (!stream.reason.empty()) {
      result.fail(address_of(context, i) + ": " + stream.reason, "an arm that sends states",
                  doctor::judge_arm_version(stream, purpose).cure);
      continue;
    }
    const double sent = static_cast<double>(stream.states + stream.lost);
    const double limit = context.virtual_arms() ? kLostShareVirtual : kLostShare;
    const std::string cable =
        "check the cable between this computer and the arm's control unit: plugs, bends, another cable; no "
        "switch in between; then resume";
    const auto share = [&](std::uint64_t states) {
      return 100 * static_cast<double>(states) / std::max(1.0, sent);
    };
    result.at_most(name, "states lost", share(stream.lost - stream.outdated), "%", 100 * limit, cable,
                   fmt::format("{} of {:.0f}", stream.lost - stream.outdated, sent));
    result.at_most(name, "states superseded before they were read", share(stream.outdated), "%",
                   context.virtual_arms() ? kShown : 100 * limit,
                   "this computer wakes too late: see the doctor's line on timer wake-up",
                   fmt::format("{} of {:.0f}", stream.outdated, sent));
    // Lost and late states both leave a torque unanswered.
    result.at_most(name, "states lost or read late", share(stream.lost), "%",
                   context.virtual_arms() ? kShown : 100 * limit, "see the two lines above for the cause",
                   fmt::format("{} of {:.0f}", stream.lost, sent));
    result.at_most(name, "states missed in a row", static_cast<double>(stream.lost_in_row), "",
                   context.virtual_arms() ? 100.0 : 10.0, cable);
  }
  return result;
}

StepResult run_versions(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const auto link = connected(context, i);
    const RobotState& state = link->next_state();
    const auto mode = fci::mode_name(state.robot_mode);
    result.show(context.arm(i).name, "protocol version", static_cast<double>(link->version()), "");
    result.notes.push_back(fmt::format("{}: {}, mode {}", address_of(context, i),
                                       doctor::arms_of_version(link->version()), mode));
    constexpr int kNewestPanda = 5;
    if (link->version() <= kNewestPanda && context.arm(i).model.starts_with("fr3")) {
      result.fail(fmt::format("{} has protocol version {}: a Panda", address_of(context, i), link->version()),
                  "an FR3, as in the scene's model '" + context.arm(i).model + "'",
                  "set 'model: fer' in the scene, or exchange the addresses");
    }
    if (!fci::is_mode(state, fci::RobotMode::idle)) {
      result.fail(fmt::format("{} is in mode '{}' {}", address_of(context, i), mode, fci::error_list(state)),
                  "mode 'idle': brakes open, FCI activated, user stop released, no error",
                  "release the user stop and end hand guiding; make sure that nobody is in its way and "
                  "recover it in its web interface");
    }
  }
  return result;
}

// Finds the arm that feels the person's hand: change of the external torque since the beginning.
StepResult run_identity(Context& context) {
  StepResult result;
  std::vector<std::unique_ptr<ArmConnection>> links;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) links.push_back(connected(context, i));
  for (ArmIndex named = 0; named < context.arm_count(); ++named) {
    const std::string& name = context.arm(named).name;
    const std::string id = "identity." + name;
    context.person.ready(
        id, fmt::format("Let go of all arms. After this key, push the arm that is called '{}' in the scene, "
                        "gently, and keep pushing for two seconds. No arm moves by itself.",
                        name));
    std::vector<JointVector> rest(links.size());
    for (std::size_t i = 0; i < links.size(); ++i) {
      (void)links[i]->look();
      rest[i] = JointVector::Zero(7);
      constexpr int kStates = 100;
      for (int k = 0; k < kStates; ++k)
        rest[i] += vector_of(links[i]->next_state().tau_ext_hat_filtered) / kStates;
    }
    context.say("  now push arm '" + name + "'");
    const HostTime begin = host_now();
    std::vector<double> felt(links.size(), 0);
    double longest = 0;
    int in_a_row = 0;
    constexpr int kEnough = 100;  // states
    while (in_a_row < kEnough && seconds(host_now() - begin) < kTouchWait_s) {
      context.check_stopped();
      for (std::size_t i = 0; i < links.size(); ++i)
        felt[i] = (vector_of(links[i]->next_state().tau_ext_hat_filtered) - rest[i]).cwiseAbs().maxCoeff();
      longest = std::max(longest, *std::max_element(felt.begin(), felt.end()));
      in_a_row = *std::max_element(felt.begin(), felt.end()) > kTouchTorque ? in_a_row + 1 : 0;
    }
    if (in_a_row < kEnough) {
      result.fail(
          fmt::format("no arm reported a push on arm '{}' within {:g} s (at most {:.1f} N m)", name,
                      kTouchWait_s, longest),
          fmt::format("more than {:g} N m on one of its joints", kTouchTorque),
          "push harder, at the hand; if it is at another address, correct the order of the addresses");
      return result;
    }
    const auto most = static_cast<std::size_t>(std::max_element(felt.begin(), felt.end()) - felt.begin());
    if (most != named) {
      result.fail(
          fmt::format("the push on arm '{}' was measured at {}, which the scene calls '{}'", name,
                      context.setup.addresses[most], context.arm(most).name),
          fmt::format("the arm at {} to feel it", context.setup.addresses[named]),
          "the addresses are swapped: exchange them in the command (or the cables), then begin again");
      return result;
    }
    double others = 0;
    for (std::size_t i = 0; i < felt.size(); ++i) others = i == named ? others : std::max(others, felt[i]);
    result.show(name, "external torque of the push", felt[named], "N m");
    result.at_most(name, "share measured by another arm", others / felt[named], "", kTouchShare,
                   "push one arm only; if the arms touch each other, move them apart");
    if (result.verdict == Verdict::no_go) return result;
    context.say(fmt::format("    arm '{}' at {}: push measured ({:.1f} N m). Let go.", name,
                            context.setup.addresses[named], felt[named]));
  }
  return result;
}

StepResult run_model(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const auto link = connected(context, i);
    const SceneArm& arm = context.arm(i);
    const auto config = fci::fci_arm_config(arm, context.setup.addresses[i]);
    if (!link->dialect().has_model_text()) {
      constexpr int kOldestFr3 = 6;
      if (link->version() >= kOldestFr3 && arm.model.starts_with("fer")) {
        result.fail(
            fmt::format("{} has protocol version {}: an FR3", address_of(context, i), link->version()),
            "a Panda, as in the scene's model '" + arm.model + "'",
            "set 'model: fr3' in the scene, or exchange the addresses");
      }
    }
    const bool as_text = link->dialect().has_model_text();
    std::string urdf;
    std::vector<std::byte> library;
    const auto compared = [&](const fci::FciArmConfig& ours) {
      return as_text ? fci::compare_models(urdf, ours.hand, *ours.model)
                     : fci::compare_models(library, ours.hand, *ours.model);
    };
    fci::ModelComparison found;
    try {
      if (as_text) urdf = link->robot_model();
      if (!as_text) library = link->model_library();
      found = compared(config);
    } catch (const std::exception& error) {
      if (as_text) throw;
      result.notes.push_back(fmt::format("{} has protocol version {}, and its model is not compared: {}",
                                         address_of(context, i), link->version(), error.what()));
      continue;
    }
    std::string better;
    if (!found.same_kinematics() || !found.same_dynamics()) {
      for (const auto& name : available_robots()) {
        try {
          SceneArm other = arm;
          other.model = name;
          other.hand = arm.hand && load_robot(name).hand.has_value();
          const auto theirs = fci::fci_arm_config(other, context.setup.addresses[i]);
          const auto match = compared(theirs);
          if (match.same_kinematics() && match.same_dynamics())
            better += (better.empty() ? "" : ", ") + ("'" + name + "'");
        } catch (const std::exception&) {  // a model with other joints
        }
      }
    }
    const std::string remedy =
        better.empty()
            ? "set the right 'model' in the scene, or identify it (docs/identification.md)"
            : "the arm's own model is " + better + ": set 'model' of arm '" + arm.name + "' in the scene";
    const std::string text = "the scene's model is '" + arm.model + "': " + found.text();
    const auto add = [&](const char* what, double value, double limit, const char* unit) {
      result.at_most(arm.name, what, value, unit, limit, remedy, text);
    };
    add("distance of the flange from the scene's model", 1e3 * found.position_m, 1e3 * found.kKinematics,
        "mm");
    add("rotation of the flange from the scene's model", 1e3 * found.orientation_rad, 1e3 * found.kKinematics,
        "mrad");
    add("difference in gravity torque", found.gravity_nm, found.gravity_limit_nm, "N m");
    add("difference in the mass matrix", 100 * found.mass_matrix, 100 * found.mass_limit, "%");
    if (!found.limits.empty()) result.notes.push_back("arm '" + arm.name + "': " + found.limits);
  }
  return result;
}

double worst_torque(const Load& a, const Load& b) {
  constexpr double kWeight = 9.81, kReach = 0.855;  // of the flange, by the arms' data sheets [m]
  return kWeight * (std::abs(a.mass - b.mass) * kReach + (a.mass * a.p_FC - b.mass * b.p_FC).norm());
}

StepResult run_end_effector(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const auto link = connected(context, i);
    const auto config = fci::fci_arm_config(context.arm(i), context.setup.addresses[i]);
    const Load theirs = fci::end_effector_of(link->next_state());
    const Load ours = fci::with(config.hand_declared.value_or(config.hand), config.tool);
    const double torque =
        std::min(worst_torque(theirs, ours), worst_torque(theirs, fci::with(config.hand, config.tool)));
    result.at_most(context.arm(i).name, "end effector: declared compared with scene", torque, "N m",
                   kDeclaredTorque,
                   "correct the end effector in the arm's web interface, or 'hand' and 'tool' in the scene",
                   fmt::format("the arm's settings declare {:.3f} kg at [{:.3f}, {:.3f}, {:.3f}] m, the "
                               "scene {:.3f} kg at [{:.3f}, {:.3f}, {:.3f}] m",
                               theirs.mass, theirs.p_FC.x(), theirs.p_FC.y(), theirs.p_FC.z(), ours.mass,
                               ours.p_FC.x(), ours.p_FC.y(), ours.p_FC.z()));
  }
  return result;
}

// Torques of an arm that holds itself, compared with the scene: checks base, end effector and load before the
// gravity compensation depends on them.
StepResult run_gravity(Context& context) {
  StepResult result;
  for (ArmIndex i = 0; i < context.arm_count(); ++i) {
    const auto link = connected(context, i);
    const Rest rest = rest_of(*link, 500);
    const RestSample& sample = rest.mean;
    const GravityFit fit = fit_gravity(context.arm(i), std::span(&sample, 1));
    const std::string& name = context.arm(i).name;
    result.measured[name]["q"] = std::vector<double>(sample.q.begin(), sample.q.end());
    result.at_most(name, "fastest joint at rest", rest.fastest, "rad/s", kStillSpeed,
                   "wait until the arm rests, and do not touch it");
    const std::string remedy = fit.load_explains()
                                   ? "remove parts that the scene does not declare, or declare them "
                                     "('load_declared', 'tool', 'hand'), also in the arm's web interface"
                                   : "correct 'base: rpy_rad' of the arm in the scene to how it is mounted, "
                                     "and its mounting in its own settings";
    result.at_most(name, "torque at rest: measured compared with scene", fit.largest_nm, "N m",
                   kGravityTorque, remedy, fmt::format("at joint {}, {}", fit.joint + 1, fit.text()));
    // A small tilt changes gravity slightly; the limit applies only to tilt that explains the difference.
    result.at_most(name, "tilt of the base against the scene", 180 / M_PI * fit.tilt_rad, "degrees",
                   fit.load_explains() ? kShown : 180 / M_PI * kTilt, remedy, fit.text());
    result.show(name, "load beyond the declared one", fit.mass_kg, "kg");
  }
  return result;
}

}  // namespace

void add_steps_at_rest(std::vector<Step>& steps, const TourSetup& setup) {
  const std::string all = setup.scene.arms.size() == 1 ? "the arm" : "the arms";
  steps.push_back(
      {"doctor", "Doctor: is this computer fit for 1 kHz?",
       fmt::format("Nothing moves. About {:.0f} s. No-go: a finding that is 'bad'.", 2 * setup.seconds),
       false, false, run_doctor});
  steps.push_back(
      {"network", "Network to " + all,
       fmt::format("Nothing moves. About {:.0f} s for each arm: card, echoes, states. No-go: more than {:g} "
                   "% of the states lost ({:g} % for arms "
                   "on this computer), or a round trip (p99) above {:g} us.",
                   2 * setup.seconds, 100 * kLostShare, 100 * kLostShareVirtual, kRoundTripP99_us),
       false, false, run_network});
  steps.push_back({"versions", "Versions and modes of " + all,
                   "Nothing moves. No-go: a mode other than idle, or an error.", false, true, run_versions});
  steps.push_back({"identity", "Which arm is which",
                   fmt::format("No arm moves by itself; you push each arm when asked. No-go: another arm "
                               "reports the push, or none within {:g} s.",
                               kTouchWait_s),
                   false, true, run_identity});
  steps.push_back(
      {"model", "Models of " + all + " compared with the scene's",
       fmt::format("Nothing moves. No-go: flanges more than {:g} mm apart, gravity torques more "
                   "than {:g} N m, mass matrices more than {:g} %; of a Panda 0.3 N m and 8 %.",
                   1e3 * fci::ModelComparison::kKinematics, fci::ModelComparison{}.gravity_limit_nm,
                   100 * fci::ModelComparison{}.mass_limit),
       false, true, run_model});
  steps.push_back(
      {"end_effector", "End effectors compared with the scene's",
       fmt::format("Nothing moves. No-go: a difference that weighs more than {:g} N m on a joint.",
                   kDeclaredTorque),
       false, true, run_end_effector});
  steps.push_back({"gravity", "Mounting and load, from the torques at rest",
                   fmt::format("Nothing moves; do not touch {}. No-go: more than {:g} N m between "
                               "measurement and scene, or a base turned by more than {:.0f} degrees.",
                               all, kGravityTorque, 180 / M_PI * kTilt),
                   false, true, run_gravity});
}

}  // namespace multipanda::commission
