#include "ros/adapter/compat/mode_services.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <rcl_interfaces/msg/parameter_type.hpp>
#include <rcutils/logging_macros.h>
#include <stdexcept>

#include <fmt/format.h>

#include "common/text.hpp"
#include "core/modes/request.hpp"
#include "ros/adapter/compat/message_type.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {
namespace {

constexpr const char* kSet = "~/set_controllers";

// The name of a choice's value; "" if the law has no such parameter.
std::string chosen(const Instance& law, const char* parameter) {
  const std::size_t i = law.find_parameter(parameter);
  if (i == law.parameter_count()) return "";
  const auto& choices = law.parameter_spec(i).choices;
  const auto value = static_cast<std::size_t>(law.parameter(i)[0]);
  return value < choices.size() ? choices[value] : "";
}

// Throws std::invalid_argument if another parameter makes the law ignore the value.
void must_not_be(const Instance& law, const char* parameter, const char* value, const char* set_to) {
  if (chosen(law, parameter) != value) return;
  throw std::invalid_argument(
      fmt::format("the parameter {} of '{}' is '{}': set it to '{}'", parameter, law.name(), value, set_to));
}

}  // namespace

Vector6 stiffness_in_world(std::span<const double> K_B, const Matrix3& R_WB) {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  const Eigen::Map<const Matrix6> K(K_B.data());
  if (!K.allFinite()) throw std::invalid_argument("stiffness: a number is not finite");
  Matrix6 R = Matrix6::Zero();
  R.topLeftCorner<3, 3>() = R.bottomRightCorner<3, 3>() = R_WB;
  const Matrix6 K_W = R * K * R.transpose();
  const Vector6 diagonal = K_W.diagonal();
  const Matrix6 rest = K_W - Matrix6(diagonal.asDiagonal());
  if (rest.cwiseAbs().maxCoeff() > 1e-6 * std::max(1.0, diagonal.cwiseAbs().maxCoeff())) {
    throw std::invalid_argument(
        "stiffness: expected a matrix that is diagonal in the axes of the world, which are those of the "
        "stiffness here");
  }
  return diagonal;
}

CompatModes::CompatModes(const AdapterContext& run, const CompatPackages& packages,
                         std::shared_ptr<AskedNames> names)
    : run_(run), table_(*run.modes), names_(std::move(names)) {
  offer_set(packages);
  offer_get(packages);
  const MultimodeController& modes = *run.modes;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    for (const auto& theirs : their_controllets()) {
      if (theirs.type != nullptr && theirs.parameters != TheirControllet::Parameters::none &&
          first_instance(modes, theirs, resource_of(modes, i)) == i)
        offer_parameters(theirs, i, packages);
    }
  }
}

void CompatModes::offer(const std::string& name, const ServiceType& type, const std::string& doc,
                        UntypedService::Callback callback) {
  services_.push_back(std::make_unique<UntypedService>(*run_.executor, *run_.node, name, type,
                                                       Doc{"on request", doc}, std::move(callback)));
}

void CompatModes::accept(const std::string& service) {
  run_.count_request(true);
  const std::lock_guard lock(mutex_);
  refused_[service].why.clear();
}

void CompatModes::refuse(const std::string& service, const std::string& why) {
  run_.count_request(false);
  {
    constexpr double kNotMoreOftenThan = 1;  // [s], for the same reason
    const std::lock_guard lock(mutex_);
    Refused& refused = refused_[service];
    const HostTime now = host_now();
    const bool known = refused.why == why && seconds(now - refused.logged) < kNotMoreOftenThan;
    refused.why = why;
    if (known) return;
    refused.logged = now;
  }
  RCUTILS_LOG_ERROR_NAMED("multipanda", "%s: refused, and therefore not answered: %s", service.c_str(),
                          why.c_str());
}

void CompatModes::offer_set(const CompatPackages& packages) {
  const auto type = ServiceType::find(packages.modes, "SetControllers");
  const Parts controllers(type.request, "controllers");
  const Text name(controllers.type(), "name");
  const Texts resources(controllers.type(), "resources");
  offer(kSet, type, "Activates controllets, those that are active start again; those of other arms stay.",
        [this, controllers, name, resources](const void* message, const UntypedService::Reply& reply) {
          std::map<InstanceIndex, std::string> asked;
          std::string refusal;
          for (std::size_t k = 0; k < controllers.size(message) && refusal.empty(); ++k) {
            const void* one = controllers.at(message, k);
            const auto arms = resources.read(one);
            if (arms.empty()) refusal = fmt::format("'{}' has no resources", name.read(one).substr(0, 60));
            for (const auto& resource : arms) {
              const auto instance = instance_of(*run_.modes, name.read(one), resource, refusal);
              if (!instance) break;
              const auto [known, is_new] = asked.try_emplace(*instance, name.read(one));
              if (is_new || known->second == name.read(one)) continue;
              refusal = fmt::format("'{}' and '{}' are both the controllet '{}' here: request one of them",
                                    known->second, name.read(one), run_.modes->instance(*instance).name());
              break;
            }
          }
          if (refusal.empty() && asked.empty()) refusal = "it names no controllet";
          if (!refusal.empty()) return refuse(kSet, refusal);
          switch_to(asked, reply);
        });
}

// Why active controllets of several arms prevent a switch; empty: they do not. An object carried by two hands
// falls if one of them leaves.
std::string CompatModes::torn_apart(InstanceSet activate) const {
  const MultimodeController& modes = *run_.modes;
  ArmSet named;
  for_each(activate, [&](InstanceIndex i) { named |= modes.instance(i).arms(); });
  std::string why;
  for_each(InstanceSet{modes.active() & ~activate}, [&](InstanceIndex i) {
    const ArmSet left = modes.instance(i).arms() - named;
    if (left.empty() || !modes.instance(i).arms().overlaps(named)) return;
    why = fmt::format("'{}' also controls {}: name a controllet for each of its arms, '{}_hold' to hold one",
                      modes.instance(i).name(), joined(names_of(modes, left)), modes.arm_name(left.first()));
  });
  return why;
}

// As in multipanda_ros2, requested controllets start again at the arm's position, even if already active:
// they are stopped first, in the same cycle.
void CompatModes::switch_to(const std::map<InstanceIndex, std::string>& asked,
                            const UntypedService::Reply& reply) {
  const MultimodeController& modes = *run_.modes;
  Request request{.kind = Request::Kind::switch_controllets};
  for (const auto& [instance, by] : asked) request.activate |= bit(instance);
  if (const std::string why = torn_apart(request.activate); !why.empty()) return refuse(kSet, why);
  const InstanceSet laws = request.activate & ~((InstanceSet{1} << modes.arm_count()) - 1);
  for (const auto& [instance, by] : asked) {
    const bool starting = (laws & bit(instance)) != 0 && names_->about_to_start(instance);
    if (starting || set_parameters_[instance].under_way > 0)
      return refuse(kSet, fmt::format("another request {} '{}': try again",
                                      starting ? "is about to start" : "sets parameters of",
                                      modes.instance(instance).name()));
  }
  std::vector<Request> requests;
  const Request end{.kind = Request::Kind::switch_controllets, .deactivate = laws & modes.active()};
  if (end.deactivate != 0) requests.push_back(end);
  for (const auto& [instance, by] : asked) {
    for (const Request& parameter : given_back(instance, by)) requests.push_back(parameter);
  }
  requests.push_back(request);
  names_->ask(request.activate);
  request_loop(run_, requests, [this, requests, laws, asked, reply](const LoopAnswer& result) {
    const Request& start = requests.back();
    names_->answered(start.activate);
    const std::size_t bad = result.first_refused();
    const bool unknown = bad < requests.size() && result.verdicts[bad] == Verdict::pending;
    for (std::size_t k = 0; k < (unknown ? requests.size() : bad); ++k) {
      if (requests[k].kind != Request::Kind::set_parameter) continue;
      set_parameters_[requests[k].instance].last = asked.at(requests[k].instance);
    }
    if (bad < requests.size()) {
      if (bad == 0) return refuse(kSet, reason(*run_.modes, start, result.verdicts[0]));
      return refuse(
          kSet, fmt::format("{} ({}): {}; 'state' shows the modes of the arms, 'recover' clears an error",
                            to_string(result.verdicts[bad]), joined(names_of(*run_.modes, start.activate)),
                            requests.front().deactivate != 0
                                ? "its active controllets have ended, and their arms are held"
                                : "nothing has started, but the parameters of its names are set"));
    }
    const InstanceSet others = laws & ~result.answer.plan.start;  // started by another request in that cycle
    for (const auto& [instance, by] : asked) {
      if ((others & bit(instance)) != 0) continue;
      names_->accept(instance, by, result.answer);
    }
    if (others != 0)
      return refuse(kSet,
                    "another request started one of its controllets at the same time, the others have "
                    "started: try again");
    accept(kSet);
    reply();
  });
}

std::vector<Request> CompatModes::given_back(InstanceIndex instance, const std::string& name) const {
  const auto known = set_parameters_.find(instance);
  if (known == set_parameters_.end() || known->second.last.empty() || known->second.last == name) return {};
  const SetParameters& set = known->second;
  const Instance& law = run_.modes->instance(instance);
  const bool as_set = std::ranges::all_of(set.values(set.last), [&](const Request& request) {
    return std::ranges::equal(law.parameter(request.index), std::span(request.values).first(request.size));
  });
  // These have another meaning in that case, or none.
  const bool same =
      chosen(law, "stiffness_axes") != "end_effector" && chosen(law, "damping_design") != "given";
  return as_set && same ? set.values(name) : std::vector<Request>();
}

void CompatModes::offer_get(const CompatPackages& packages) {
  const auto type = ServiceType::find(packages.modes, "GetControllers");
  const Parts controllers(type.response, "controllers");
  const Text name(controllers.type(), "name");
  const Texts resources(controllers.type(), "resources");
  offer("~/get_controllers", type, "Active controllets.",
        [this, controllers, name, resources](const void*, const UntypedService::Reply& reply) {
          const MultimodeController& modes = *run_.modes;
          std::vector<InstanceIndex> active;
          for (auto i = static_cast<InstanceIndex>(modes.arm_count()); i < modes.instance_count(); ++i) {
            if ((modes.active() & bit(i)) != 0) active.push_back(i);
          }
          reply([&](void* response) {
            controllers.resize(response, active.size());
            for (std::size_t k = 0; k < active.size(); ++k) {
              void* one = controllers.at(response, k);
              name.write(one, names_->name(active[k]));
              resources.write(one, {resource_of(modes, active[k])});
            }
          });
          run_.count_request(true);
        });
}

void CompatModes::offer_parameters(const TheirControllet& theirs, InstanceIndex instance,
                                   const CompatPackages& packages) {
  const MultimodeController& modes = *run_.modes;
  const Instance& law = modes.instance(instance);
  const std::string service =
      resource_name(modes, law.arm_list(), "_and_") + "/" + theirs.name + "/parameters";
  const auto guarded = [this, service](auto read) {
    return [this, service, read](const void* message, const UntypedService::Reply& reply) {
      try {
        read(message, reply);
      } catch (const std::invalid_argument& error) {
        refuse(service, error.what());
      }
    };
  };
  if (theirs.parameters == TheirControllet::Parameters::joints) {
    const auto type = ServiceType::find(packages.modes, "SetJointImpedance");
    const Numbers scale(type.request, {"stiffness_scale"}, 1);
    offer(service, type, "Stiffness of the joints, as a multiple of 600 (4), 250, 150, 50 N m/rad.",
          guarded([=, this, name = std::string(theirs.name)](const void* message,
                                                             const UntypedService::Reply& reply) {
            std::vector<double> stiffness{600, 600, 600, 600, 250, 150, 50};
            for (double& value : stiffness) value *= scale.read(message)[0];
            set(service, name, instance, {{"stiffness_nm_per_rad", stiffness}}, reply);
          }));
    return;
  }
  const auto type = ServiceType::find(packages.modes, "SetCartesianImpedance");
  const Numbers stiffness(type.request, {"stiffness"}, 36);
  const Numbers damping(type.request, {"damping_ratio"}, 6);
  const Numbers nullspace(type.request, {"nullspace_stiffness"}, 1);
  offer(service, type, "Stiffnesses (axes of the arms' bases), damping ratio, stiffness of the null space.",
        guarded([=, this, &law, name = std::string(theirs.name)](const void* message,
                                                                 const UntypedService::Reply& reply) {
          must_not_be(law, "stiffness_axes", "end_effector", "world");
          must_not_be(law, "damping_design", "given", "coupled");  // which has no damping ratio
          const auto K = stiffness.read(message);
          std::optional<Vector6> K_W;
          for (const ArmIndex arm : law.arm_list()) {
            const Vector6 own = stiffness_in_world(K, run_.models[arm]->X_WB().rotation);
            if (K_W && !K_W->isApprox(own, 1e-6))
              throw std::invalid_argument(
                  "stiffness: the arms' bases have different orientations, so the stiffness differs in the "
                  "world; here both arms share one stiffness");
            K_W = own;
          }
          const auto ratios = damping.read(message);
          if (std::any_of(ratios.begin(), ratios.end(), [&](double ratio) {
                return !std::isfinite(ratio) || std::abs(ratio - ratios[0]) > 1e-6;
              }))
            throw std::invalid_argument("damping_ratio: expected six equal numbers: only one is used");
          set(service, name, instance,
              {{"translational_stiffness_n_per_m", {(*K_W)[0], (*K_W)[1], (*K_W)[2]}},
               {"rotational_stiffness_nm_per_rad", {(*K_W)[3], (*K_W)[4], (*K_W)[5]}},
               {"damping_ratio", {ratios[0]}},
               {"nullspace_stiffness_nm_per_rad", nullspace.read(message)}},
              reply);
        }));
}

void CompatModes::set(const std::string& service, const std::string& theirs, InstanceIndex instance,
                      const std::vector<std::pair<std::string, std::vector<double>>>& values,
                      const UntypedService::Reply& reply) {
  // Their controllet has parameters of its own: the arm must not become stiff suddenly.
  const bool active = (run_.modes->active() & bit(instance)) != 0;
  if (active || names_->about_to_start(instance)) {
    if (const std::string why = names_->refusal(instance, theirs); !why.empty())
      throw std::invalid_argument(why);
  }
  std::vector<Request> requests;
  for (const auto& [name, numbers] : values) {
    rcl_interfaces::msg::Parameter parameter;
    parameter.name = run_.modes->instance(instance).name() + "." + name;
    parameter.value.type = rcl_interfaces::msg::ParameterType::PARAMETER_DOUBLE_ARRAY;
    parameter.value.double_array_value = numbers;
    std::string why;
    const auto request = table_.request(parameter, why);
    if (!request) throw std::invalid_argument(why);
    requests.push_back(*request);
  }
  SetParameters& known = set_parameters_[instance];
  if (known.last.empty() && known.under_way == 0) {
    known.before = requests;
    for (Request& request : known.before)
      std::ranges::copy(run_.modes->instance(instance).parameter(request.index), request.values.begin());
  }
  ++known.under_way;
  request_loop(run_, requests, [this, service, theirs, instance, requests, reply](const LoopAnswer& result) {
    SetParameters& set = set_parameters_[instance];
    --set.under_way;
    const std::size_t bad = result.first_refused();
    if (bad < requests.size())
      return refuse(service, reason(*run_.modes, requests[bad], result.verdicts[bad]));
    set.of[theirs] = requests;
    set.last = theirs;
    accept(service);
    reply();
  });
}

std::vector<Diagnostic> CompatModes::diagnostics() const {
  const std::lock_guard lock(mutex_);
  std::vector<Diagnostic> lines;
  for (const auto& [service, refused] : refused_) {
    Diagnostic line{.name = "compat " + service};
    if (!refused.why.empty()) {
      line.level = Diagnostic::Level::error;
      line.message = "the newest request was refused: " + refused.why;
    }
    lines.push_back(std::move(line));
  }
  return lines;
}

}  // namespace multipanda::ros
