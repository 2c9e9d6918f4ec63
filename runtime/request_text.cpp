#include "runtime/request_text.hpp"

#include <algorithm>
#include <bit>

#include "common/text.hpp"

namespace multipanda {
namespace {

// Conditions on the state for starting these controllets' features.
std::string conditions_of(const MultimodeController& modes, InstanceSet set) {
  std::string text;
  for (; set != 0; set &= set - 1) {
    const Instance& instance = modes.instance(static_cast<InstanceIndex>(std::countr_zero(set)));
    for (std::size_t i = 0; i < instance.feature_count(); ++i) {
      if (!instance.feature_on(i) || instance.start_condition(i).empty()) continue;
      text += "; '" + instance.feature_descriptor(i).type + "' of '" + instance.name() +
              "': " + std::string(instance.start_condition(i));
    }
  }
  return text;
}

}  // namespace

std::vector<std::string> names_of(const MultimodeController& modes, InstanceSet set) {
  std::vector<std::string> names;
  for (; set != 0; set &= set - 1) {
    names.push_back(modes.instance(static_cast<InstanceIndex>(std::countr_zero(set))).name());
  }
  return names;
}

std::vector<std::string> names_of(const MultimodeController& modes, ArmSet arms) {
  std::vector<std::string> names;
  for (ArmIndex a = 0; a < modes.arm_count(); ++a) {
    if (arms.contains(a)) names.push_back(modes.arm_name(a));
  }
  return names;
}

std::vector<std::string> instance_names(const MultimodeController& modes) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < modes.instance_count(); ++i) {
    names.push_back(modes.instance(static_cast<InstanceIndex>(i)).name());
  }
  return names;
}

std::string reason(const MultimodeController& modes, const Request& request, Verdict verdict,
                   Intervention rule) {
  const bool set = request.instance < modes.instance_count();
  switch (verdict) {
    case Verdict::two_owners:
      for (InstanceIndex a = 0; a < modes.instance_count(); ++a) {
        for (InstanceIndex b = 0; b < a; ++b) {
          if ((request.activate & bit(a)) == 0 || (request.activate & bit(b)) == 0) continue;
          const ArmSet common = modes.instance(a).arms() & modes.instance(b).arms();
          if (common.empty()) continue;
          return in_quotes(modes.instance(b).name()) + " and " + in_quotes(modes.instance(a).name()) +
                 " both own arm " + in_quotes(modes.arm_name(common.first())) + ": activate one of them";
        }
      }
      break;
    case Verdict::arm_stopped:
      if (request.kind == Request::Kind::resume && modes.stopped().overlaps(request.arms))
        return joined(names_of(modes, modes.stopped() & request.arms)) +
               " was stopped again after the state that the sender saw: look at the arms and at the reason, "
               "then resume";
      if (modes.stopped().empty())
        return "the request was sent before a stop that has been resumed since: look at the arms, then send "
               "it again";
      return "stopped: " + joined(names_of(modes, modes.stopped())) + "; resume first";
    case Verdict::not_active:
      if (set)
        return in_quotes(modes.instance(request.instance).name()) +
               " is not active and set-points reach active controllets only; activate it first";
      break;
    case Verdict::wrong_size:
    case Verdict::not_finite:
    case Verdict::out_of_bounds:
      if (std::string why = modes.refusal(request); !why.empty()) return why;
      if (verdict == Verdict::out_of_bounds && set && request.kind == Request::Kind::set_parameter) {
        const Instance& target = modes.instance(request.instance);
        const std::string why =
            target.bound_text(request.index, std::span(request.values).first(request.size));
        if (!why.empty()) return why;
        const ParameterSpec& spec = target.parameter_spec(request.index);
        const auto values = std::span(request.values).first(request.size);
        const auto wrong =
            std::ranges::find_if(values, [&spec](double x) { return x < spec.min || x > spec.max; });
        return in_quotes(spec.name) + " must be " + number_text(spec.min) + " to " + number_text(spec.max) +
               (spec.unit.empty() ? "" : " " + spec.unit) +
               (wrong == values.end() ? "" : ", found " + number_text(*wrong));
      }
      break;
    case Verdict::arm_not_ready:
    case Verdict::start_refused:
      if (set && request.kind == Request::Kind::set_feature) {
        const Instance& target = modes.instance(request.instance);
        std::string_view why = target.feature_refusal(request.index);
        if (why.empty() && verdict == Verdict::start_refused) why = target.start_condition(request.index);
        if (!why.empty())
          return in_quotes(target.feature_descriptor(request.index).type) + ": " + std::string(why);
      }
      if (rule >= Intervention::force_sensor_silent && rule < Intervention::count_)
        return std::string(to_string(rule)) + " (" + joined(names_of(modes, request.activate)) +
               "): nothing was changed; the law needs the force: look at the sensor, its cable and the run's "
               "messages; a tare needs the arm at rest and free";
      if (rule != Intervention::none && rule != Intervention::arm_not_ready)
        return std::string(to_string(rule)) + " (" + joined(names_of(modes, request.activate)) +
               "): an arm would be held again at once; nothing was changed; guide the arm back by hand, or "
               "stop and resume it, which frees it once, and try again";
      return std::string(to_string(verdict)) + " (" + joined(names_of(modes, request.activate)) +
             "); nothing was changed; 'state' shows the modes of the arms, 'recover' clears an error" +
             (verdict == Verdict::start_refused ? conditions_of(modes, request.activate) : "");
    case Verdict::timeout:
      return "the loop did not take the request within 1 s, and it will not be executed: the arms may not be "
             "connected yet, the simulation may be paused, the program may have stalled, or the run may have "
             "ended";
    case Verdict::pending:
      return "the loop took the request, but its answer was lost: check 'state' before you try again";
    default:
      break;
  }
  return std::string(to_string(verdict));
}

std::future<RequestAnswer> request_arm(const MultimodeController& modes, Backend& backend, ArmIndex arm,
                                       ArmRequest request) {
  if (std::holds_alternative<SetLoad>(request)) {
    const std::string who = "arm " + in_quotes(modes.arm_name(arm));
    const Instance& owner = modes.instance(modes.owner(arm));
    if (modes.stopped().contains(arm))
      return refuse_request(who + " is stopped, and another load would move it: resume it first");
    if (owner.descriptor().guided)
      return refuse_request(who + " is guided by hand by " + in_quotes(owner.name()) +
                            ", and another load would move it: switch to another controllet first");
  }
  return backend.request(arm, std::move(request));
}

bool gripper_stops(const MultimodeController& modes, ArmIndex arm, std::uint8_t mode) {
  const auto now = static_cast<ArmMode>(mode);
  return modes.stopped().contains(arm) || now == ArmMode::user_stopped || now == ArmMode::reflex;
}

std::optional<GripperRequest> ending_of(const GripperRequest& request, bool grasped) {
  const bool sucks = std::holds_alternative<VacuumOn>(request);
  if (ends_motion(request) || (grasped && (sucks || std::holds_alternative<GripperGrasp>(request))))
    return {};
  if (std::holds_alternative<GripperFollow>(request)) return GripperFollow{};
  if (sucks || std::holds_alternative<VacuumDrop>(request)) return VacuumStop{};
  return GripperStop{};
}

std::future<RequestAnswer> request_arm(const MultimodeController& modes, Backend& backend, ArmIndex arm,
                                       GripperRequest request, std::uint8_t mode) {
  if (ends_motion(request) || !gripper_stops(modes, arm, mode))
    return backend.request(arm, std::move(request));
  const bool stopped = modes.stopped().contains(arm), reflex = static_cast<ArmMode>(mode) == ArmMode::reflex;
  return refuse_request("arm " + in_quotes(modes.arm_name(arm)) + " is stopped" +
                        (stopped  ? ""
                         : reflex ? " by a reflex"
                                  : " by its button") +
                        ", and so is its gripper: " +
                        (stopped  ? "resume the arm"
                         : reflex ? "recover the arm"
                                  : "release the button") +
                        " first; 'stop' of the gripper lets go of what it holds");
}

std::string no_such_controllet(const MultimodeController& modes, const std::string& name) {
  return "there is no controllet " + in_quotes(name) +
         name_hint(name, instance_names(modes), "there are none");
}

std::string no_such_arm(const MultimodeController& modes, const std::string& name) {
  return "there is no arm " + in_quotes(name) +
         name_hint(name, names_of(modes, ArmSet::all(modes.arm_count())), "there are none");
}

std::string no_such_feature(const Instance& instance, const std::string& name) {
  std::vector<std::string> valid;
  for (std::size_t i = 0; i < instance.feature_count(); ++i)
    valid.push_back(instance.feature_descriptor(i).type);
  return "there is no feature " + in_quotes(name) + name_hint(name, valid, "there are none");
}

std::string no_such_parameter(const Instance& instance, const std::string& name) {
  return has_no(instance.name(), "parameter", name, instance.parameter_names());
}

std::string no_such_input(const Instance& instance, const std::string& name) {
  std::vector<std::string> valid;
  for (const Reference& input : instance.inputs()) valid.push_back(input.spec().name);
  return has_no(instance.name(), "input", name, valid);
}

}  // namespace multipanda
