#include "runtime/request_text.hpp"

#include <bit>

#include <nlohmann/json.hpp>

#include "support/spelling.hpp"

namespace multipanda {
namespace {

std::string quoted(const std::string& name) { return "'" + name + "'"; }

// Limits the length of a mistyped name in messages.
std::string shortened(const std::string& name) { return quoted(name.substr(0, 60)); }

// The shortest text that reads back as the same number.
std::string shortest(double value) { return nlohmann::json(value).dump(); }

// What the features of these controllets ask of the state when they start.
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

std::string reason(const MultimodeController& modes, const Request& request, Verdict verdict) {
  const bool set = request.instance < modes.instance_count();
  switch (verdict) {
    case Verdict::two_owners:
      for (InstanceIndex a = 0; a < modes.instance_count(); ++a) {
        for (InstanceIndex b = 0; b < a; ++b) {
          if ((request.activate & bit(a)) == 0 || (request.activate & bit(b)) == 0) continue;
          const ArmSet common = modes.instance(a).arms() & modes.instance(b).arms();
          if (common.empty()) continue;
          return quoted(modes.instance(b).name()) + " and " + quoted(modes.instance(a).name()) +
                 " both own arm " + quoted(modes.arm_name(common.first())) + ": activate one of them";
        }
      }
      break;
    case Verdict::arm_stopped:
      return "stopped: " + joined(names_of(modes, modes.stopped())) + "; resume first";
    case Verdict::not_active:
      if (set)
        return quoted(modes.instance(request.instance).name()) +
               " is not active and set-points reach active controllets only; activate it first";
      break;
    case Verdict::out_of_bounds:
      if (set && request.kind == Request::Kind::set_parameter) {
        const Instance& target = modes.instance(request.instance);
        const std::string why =
            target.bound_text(request.index, std::span(request.values).first(request.size));
        if (!why.empty()) return why;
        const ParameterSpec& spec = target.parameter_spec(request.index);
        return quoted(spec.name) + " must be " + shortest(spec.min) + " to " + shortest(spec.max) +
               (spec.unit.empty() ? "" : " " + spec.unit);
      }
      break;
    case Verdict::arm_not_ready:
    case Verdict::start_refused:
      if (set && request.kind == Request::Kind::set_feature) {
        const Instance& target = modes.instance(request.instance);
        std::string_view why = target.feature_refusal(request.index);
        if (why.empty() && verdict == Verdict::start_refused) why = target.start_condition(request.index);
        if (!why.empty())
          return quoted(target.feature_descriptor(request.index).type) + ": " + std::string(why);
      }
      return std::string(to_string(verdict)) + " (" + joined(names_of(modes, request.activate)) +
             "); nothing was changed; 'state' shows the modes of the arms, 'recover' clears an error" +
             (verdict == Verdict::start_refused ? conditions_of(modes, request.activate) : "");
    case Verdict::timeout:
      return "the loop did not take the request within 1 s, and it will not be executed: the arms may not be "
             "connected yet, the simulation may be paused, or the run may have ended";
    case Verdict::pending:
      return "the loop took the request, but its answer was lost: look at 'state' before asking again";
    default:
      break;
  }
  return std::string(to_string(verdict));
}

std::string no_such_controllet(const MultimodeController& modes, const std::string& name) {
  return "there is no controllet " + shortened(name) +
         name_hint(name, instance_names(modes), "there are none");
}

std::string no_such_arm(const MultimodeController& modes, const std::string& name) {
  return "there is no arm " + shortened(name) +
         name_hint(name, names_of(modes, ArmSet::all(modes.arm_count())), "there are none");
}

std::string no_such_feature(const Instance& instance, const std::string& name) {
  std::vector<std::string> valid;
  for (std::size_t i = 0; i < instance.feature_count(); ++i)
    valid.push_back(instance.feature_descriptor(i).type);
  return "there is no feature " + shortened(name) + name_hint(name, valid, "there are none");
}

std::string no_such_parameter(const Instance& instance, const std::string& name) {
  return quoted(instance.name()) + " has no parameter " + shortened(name) +
         name_hint(name, instance.parameter_names(), "it has none");
}

}  // namespace multipanda
