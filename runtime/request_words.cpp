#include "runtime/request_words.hpp"

#include <array>
#include <bit>

#include <nlohmann/json.hpp>

#include "scene/names.hpp"

namespace multipanda {
namespace {

constexpr std::array<std::string_view, static_cast<std::size_t>(Verdict::count_)> kVerdictNames = {
    "pending",           "accepted",      "unknown_instance", "unknown_arm", "unknown_feature",
    "unknown_parameter", "unknown_input", "wrong_size",       "not_finite",  "out_of_bounds",
    "two_owners",        "arm_stopped",   "arm_not_ready",    "not_active",  "start_refused",
    "superseded",        "queue_full",    "loop_not_running", "timeout"};
static_assert(!kVerdictNames.back().empty(), "every verdict has a name");

std::string quoted(const std::string& name) { return "'" + name + "'"; }

// A mistyped name of any length must not make a message of that length.
std::string shortened(const std::string& name) { return quoted(name.substr(0, 60)); }

// The shortest that reads back the same.
std::string shortest(double value) { return nlohmann::json(value).dump(); }

}  // namespace

std::string_view name_of(Verdict verdict) {
  const auto i = static_cast<std::size_t>(verdict);
  return i < kVerdictNames.size() ? kVerdictNames[i] : "unknown";
}

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
               " is not running, set-points reach running controllets only: switch it on first";
      break;
    case Verdict::out_of_bounds:
      if (set && request.kind == Request::Kind::set_parameter) {
        const ParameterSpec& spec = modes.instance(request.instance).parameter_spec(request.index);
        return quoted(spec.name) + " must be " + shortest(spec.min) + " to " + shortest(spec.max) +
               (spec.unit.empty() ? "" : " " + spec.unit);
      }
      break;
    case Verdict::arm_not_ready:
    case Verdict::start_refused:
      if (set && request.kind == Request::Kind::set_feature) {
        const Instance& target = modes.instance(request.instance);
        const std::string_view why = target.feature_refusal(request.index);
        if (!why.empty())
          return quoted(target.feature_statement(request.index).type) + ": " + std::string(why);
      }
      return std::string(to_string(verdict)) + " (" + joined(names_of(modes, request.activate)) +
             "): nothing was changed; 'state' shows the arms' modes, 'recover' clears an error";
    case Verdict::timeout:
      return "the loop did not take it within 1 s: is the simulation paused, or the run over?";
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
    valid.push_back(instance.feature_statement(i).type);
  return "there is no feature " + shortened(name) + name_hint(name, valid, "there are none");
}

std::string no_such_parameter(const Instance& instance, const std::string& name) {
  return quoted(instance.name()) + " has no parameter " + shortened(name) +
         name_hint(name, instance.parameter_names(), "it has none");
}

}  // namespace multipanda
