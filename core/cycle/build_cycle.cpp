#include <algorithm>
#include <stdexcept>

#include "core/cycle/control_cycle.hpp"
#include "core/model/prismatic_joints.hpp"

namespace multipanda {
namespace {

std::vector<std::shared_ptr<const ArmModel>> models_of(const CycleConfig& config) {
  std::vector<std::shared_ptr<const ArmModel>> models;
  for (const auto& arm : config.arms) models.push_back(arm.model);
  return models;
}

// With the backend's information on its arms.
std::vector<SafetyLimits> limits_of(const CycleConfig& config, const Backend& backend) {
  std::vector<SafetyLimits> limits;
  for (ArmIndex arm = 0; arm < config.arms.size(); ++arm) {
    SafetyLimits& of_arm = limits.emplace_back(config.arms[arm].safety);
    if (arm >= backend.arm_count()) continue;  // refused below
    const Capabilities can = backend.capabilities(arm);
    if (can.own_clock) of_arm.own_clock_slack_s = 2.5 * of_arm.period_s;
    of_arm.low_pass_hz = can.torque_low_pass_hz;
    of_arm.joints.tau_rate_max = of_arm.joints.tau_rate_max.cwiseMin(can.torque_rate_max);
  }
  return limits;
}

std::vector<std::optional<BaseMount>> mounts_of(const CycleConfig& config) {
  std::vector<std::optional<BaseMount>> mounts;
  for (const auto& arm : config.arms) mounts.push_back(arm.mount);
  return mounts;
}

// The carrier of an arm stands in the world, carries one arm, and the joints that move that arm do not turn
// it against gravity: an arm compensates gravity for the direction in which it was mounted.
void check_mount(const CycleConfig& config, const Backend& backend, ArmIndex arm) {
  if (!config.arms[arm].mount) return;
  const BaseMount& mount = *config.arms[arm].mount;
  const std::string who = "arm '" + config.arms[arm].name + "' ";
  if (mount.carrier >= config.arms.size() || mount.carrier == arm)
    throw std::invalid_argument(who + "stands on arm number " + std::to_string(mount.carrier) +
                                "; expected another arm of this loop");
  const auto& carrier = config.arms[mount.carrier];
  if (carrier.mount)
    throw std::invalid_argument(who + "stands on arm '" + carrier.name +
                                "', which stands on an arm itself; expected one that stands in the world");
  for (ArmIndex other = 0; other < arm; ++other) {
    if (config.arms[other].mount && config.arms[other].mount->carrier == mount.carrier)
      throw std::invalid_argument(who + "and arm '" + config.arms[other].name + "' stand on arm '" +
                                  carrier.name + "'; expected one at most");
  }
  if (mount.joint >= carrier.model->joint_count())
    throw std::invalid_argument(
        who + "stands behind joint " + std::to_string(mount.joint + 1) + " of arm '" + carrier.name +
        "', which has " + std::to_string(carrier.model->joint_count()) + "; expected one of its joints");
  // A law may control a real arm together with a carried one, and an arm's own estimate of forces assumes a
  // fixed base.
  for (ArmIndex other = 0; other < config.arms.size(); ++other) {
    if (!backend.capabilities(other).simulated)
      throw std::invalid_argument(who + "stands on arm '" + carrier.name + "', and arm '" +
                                  config.arms[other].name +
                                  "' is not simulated; expected simulated arms only");
  }
  for (const ArmIndex of_two : {arm, mount.carrier}) {
    if (backend.capabilities(of_two).has_external_torque)
      throw std::invalid_argument(
          who + "stands on arm '" + carrier.name + "', and arm '" + config.arms[of_two].name +
          "' estimates its external torques itself, for a base that stands still; use the "
          "backend mujoco, which leaves that to the loop");
  }
  if (const std::string why = turns_against_gravity(*carrier.model, mount.joint); !why.empty())
    throw std::invalid_argument(who + "stands on arm '" + carrier.name + "': " + why);
}

std::vector<std::string> names_of(const CycleConfig& config) {
  std::vector<std::string> names;
  for (const auto& arm : config.arms) names.push_back(arm.name);
  return names;
}

// The values in the places of spent ones, at which instances look.
template <typename Values>
void put(Values& values, Values& places) {
  std::ranges::move(values, places.begin());
  values.swap(places);
}

CycleData placed(CycleData data, CycleData* spent) {
  if (spent == nullptr) return data;
  put(data.state, spent->state);
  put(data.condition, spent->condition);
  put(data.obstacles, spent->obstacles);
  put(data.terms, spent->terms);
  put(data.tau_controllet, spent->tau_controllet);
  put(data.tau_feature, spent->tau_feature);
  return data;
}

}  // namespace

ControlCycle::ControlCycle(const CycleConfig& config, const Registry& registry, Backend& backend,
                           std::unique_ptr<ControlCycle> spent)
    : backend_(backend),
      data_(placed(CycleData(models_of(config), config.obstacles), spent ? &spent->data_ : nullptr)),
      mounts_(mounts_of(config)),
      safety_(limits_of(config, backend)) {
  if (config.arms.empty() || config.arms.size() > kMaxArms) {
    throw std::invalid_argument("1 to " + std::to_string(kMaxArms) + " arms are supported, not " +
                                std::to_string(config.arms.size()));
  }
  if (config.arms.size() != backend.arm_count()) {
    throw std::invalid_argument("the backend has " + std::to_string(backend.arm_count()) + " arms, " +
                                std::to_string(config.arms.size()) + " are configured");
  }
  for (ArmIndex arm = 0; arm < config.arms.size(); ++arm) {
    const std::string weight = weight_on_an_axis(*config.arms[arm].model, safety_.limits(arm).joints.tau_max);
    if (!weight.empty()) throw std::invalid_argument(weight);
    check_mount(config, backend, arm);
    const double hz = config.arms[arm].observer_hz;
    observers_.emplace_back(config.arms[arm].model->joint_count(),
                            hz > 0 ? hz : ExternalForceObserver::kBandwidth);
    sensed_.emplace_back();
    if (const auto& mount = config.arms[arm].force_sensor) {
      if (backend.force_reading(arm) == nullptr)
        throw std::invalid_argument("arm '" + config.arms[arm].name +
                                    "' has a force sensor, which this backend does not read; use mujoco or "
                                    "fci, or remove 'force_sensor'");
      sensed_.back().emplace(*mount);
    }
    // The estimate of an arm with a moving base, or that carries one, cannot check its sensor.
    const bool rides = sensed_.back() && std::ranges::any_of(config.arms, [&](const CycleConfig::Arm& other) {
                         return other.mount && (&other == &config.arms[arm] || other.mount->carrier == arm);
                       });
    if (hz > 0 || rides || !backend.capabilities(arm).has_external_torque) observed_ |= ArmSet::of(arm);
  }
  for (ArmIndex arm = 0; arm < mounts_.size(); ++arm) {
    if (mounts_[arm]) data_.terms[mounts_[arm]->carrier].carry(data_.terms[arm], mounts_[arm]->joint);
  }
  seen_config_.resize(config.arms.size());
  place_bases();
  // Only in a world that is simulated for all arms: objects removed there are still present before a
  // real arm.
  const bool all_simulated = [&] {
    for (ArmIndex arm = 0; arm < config.arms.size(); ++arm) {
      if (!backend.capabilities(arm).simulated) return false;
    }
    return true;
  }();
  for (std::size_t i = 0; all_simulated && i < data_.obstacles.size(); ++i) {
    if (data_.obstacles[i].is_placed) placed_.push_back(i);
  }
  ArmSet friction_compensated;
  for (ArmIndex arm = 0; arm < config.arms.size(); ++arm) {
    if (backend.capabilities(arm).compensates_friction) friction_compensated |= ArmSet::of(arm);
  }
  const ArmBlocks blocks{data_.state,     data_.terms,          data_.tau_controllet, data_.tau_feature,
                         data_.obstacles, friction_compensated, data_.condition,      mounts_};
  modes_ = std::make_unique<MultimodeController>(names_of(config), config.controllets, registry, blocks,
                                                 safety_, spent ? spent->modes_.get() : nullptr);
  layout_ = spent ? std::move(spent->layout_) : modes_->layout();
  if (config.record_capacity > 0) {
    record_ = std::make_unique<RecordRing>(layout_, config.record_capacity);
    modes_->record_to(record_.get());
  }
}

}  // namespace multipanda
