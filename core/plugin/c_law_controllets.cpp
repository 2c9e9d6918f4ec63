#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>

#include "core/plugin/load_plugin.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kMostOutputs = 256;       // numbers
constexpr std::size_t kMostMemory = 1u << 16u;  // numbers
constexpr std::size_t kMostEntries = 64;        // inputs, parameters or outputs

// --- Descriptor ---

struct Law {
  std::string what;  // for messages
  [[noreturn]] void refuse(const std::string& why) const { throw std::runtime_error(what + ": " + why); }
};

bool is_identifier(const std::string& text) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  return !text.empty() && text.size() <= 64 && letter(text[0]) &&
         std::ranges::all_of(text, [&](char c) { return letter(c) || (c >= '0' && c <= '9') || c == '_'; });
}

std::string text_of(const char* text, const Law& law, const std::string& what) {
  if (text == nullptr) law.refuse(what + " is missing");
  return text;
}

std::string name_of(const char* text, const Law& law, const std::string& what, std::set<std::string>& names) {
  const std::string name = text_of(text, law, "the name of " + what);
  if (!is_identifier(name)) {
    law.refuse(what + " is called '" + name + "'; expected a letter, then letters, digits or _, 64 at most");
  }
  if (!names.insert(name).second) law.refuse("two of its names are '" + name + "'");
  return name;
}

template <typename Entry>
std::span<const Entry> list_of(const Entry* first, std::size_t count, const Law& law,
                               const std::string& what) {
  if (count > kMostEntries)
    law.refuse("it has " + std::to_string(count) + ' ' + what + "; at most " + std::to_string(kMostEntries) +
               " are possible");
  if (count > 0 && first == nullptr) law.refuse("the list of its " + what + " is missing");
  return {first, count};
}

InputSpec input_spec(const multipanda_c_input& given, const Law& law, std::size_t arms,
                     std::set<std::string>& names) {
  InputSpec spec;
  spec.name = name_of(given.name, law, "an input", names);
  spec.doc = text_of(given.doc, law, "the doc of input '" + spec.name + "'");
  if (given.quantity > MULTIPANDA_SCALAR)
    law.refuse("input '" + spec.name + "' has the unknown quantity " + std::to_string(given.quantity));
  spec.quantity = static_cast<Quantity>(given.quantity);
  if (given.arm >= arms) {
    law.refuse("input '" + spec.name + "' belongs to arm number " + std::to_string(given.arm) + " of " +
               std::to_string(arms));
  }
  spec.arm = given.arm;
  return spec;
}

ParameterSpec parameter_spec(const multipanda_c_parameter& given, const Law& law,
                             std::set<std::string>& names) {
  ParameterSpec spec;
  spec.name = name_of(given.name, law, "a parameter", names);
  const std::string what = "parameter '" + spec.name + "'";
  spec.unit = text_of(given.unit, law, "the unit of " + what);
  spec.doc = text_of(given.doc, law, "the doc of " + what);
  if (given.size > kMaxParameterSize)
    law.refuse(what + " has " + std::to_string(given.size) + " numbers; at most " +
               std::to_string(kMaxParameterSize) + " are possible");
  spec.size = given.size;
  static_assert(MULTIPANDA_PER_JOINT == ParameterSpec::kPerJoint);
  const std::size_t needed = spec.size == ParameterSpec::kPerJoint ? kMaxJoints : spec.size;
  if (given.initial == nullptr || (given.initial_count != 1 && given.initial_count != needed)) {
    law.refuse(what + " has " + std::to_string(given.initial_count) + " initial values; expected 1 or " +
               std::to_string(needed));
  }
  spec.initial.assign(given.initial, given.initial + given.initial_count);
  spec.min = given.min;
  spec.max = given.max;
  if (!std::isfinite(spec.min) || !std::isfinite(spec.max) || !(spec.min <= spec.max))
    law.refuse(what + " needs finite bounds, min <= max");
  for (const double value : spec.initial) {
    if (!(value >= spec.min && value <= spec.max))
      law.refuse(what + ": an initial value is out of its bounds");
  }
  return spec;
}

ControlletDescriptor descriptor_of(const multipanda_c_law& given) {
  std::set<std::string> own, inputs, parameters, outputs;
  ControlletDescriptor descriptor;
  descriptor.type = name_of(given.type, {"a law"}, "it", own);
  const Law law{"law '" + descriptor.type + "'"};
  descriptor.doc = text_of(given.doc, law, "its doc");
  descriptor.arms = given.arms;
  if (given.arms == 0 || given.arms > kMaxArms)
    law.refuse("it owns " + std::to_string(given.arms) + " arms; expected 1 to " + std::to_string(kMaxArms));
  if (given.update == nullptr) law.refuse("its function 'update' is missing");
  constexpr std::uint32_t kAllUses = 2u * MULTIPANDA_USES_TAU_J - 1u;
  if ((given.uses & ~kAllUses) != 0) law.refuse("it uses something that this program does not have");
  if (given.memory_size > kMostMemory) {
    law.refuse("it needs a memory of " + std::to_string(given.memory_size) + " numbers; at most " +
               std::to_string(kMostMemory) + " are possible");
  }
  for (const auto& input : list_of(given.inputs, given.input_count, law, "inputs"))
    descriptor.inputs.push_back(input_spec(input, law, given.arms, inputs));
  for (const auto& parameter : list_of(given.parameters, given.parameter_count, law, "parameters"))
    descriptor.parameters.push_back(parameter_spec(parameter, law, parameters));
  std::size_t numbers = 0;
  for (const auto& output : list_of(given.outputs, given.output_count, law, "outputs")) {
    OutputSpec spec;
    spec.name = name_of(output.name, law, "an output", outputs);
    spec.doc = text_of(output.doc, law, "the doc of output '" + spec.name + "'");
    spec.size = output.size;
    numbers += spec.size;
    if (spec.size == 0 || numbers > kMostOutputs)
      law.refuse("its outputs need 1 to " + std::to_string(kMostOutputs) + " numbers altogether");
    descriptor.outputs.push_back(std::move(spec));
  }
  return descriptor;
}

// --- Law ---

class CLaw final : public Controllet {
 public:
  CLaw(const multipanda_c_law& law, ArmModels models)
      : law_(law),
        arms_(models.size()),
        plain_arms_(models.size()),
        inputs_(law.input_count),
        set_points_(law.input_count),
        parameters_(law.parameter_count),
        memory_(law.memory_size) {}

  LawResult start(ControlContext& context) override {
    std::ranges::fill(memory_, 0.0);
    if (law_.start == nullptr) return has_estimates(context) ? LawResult::ok : LawResult::fault;
    return call(law_.start, context);
  }

  LawResult update(ControlContext& context) override {
    if (call(law_.update, context) != LawResult::ok) return LawResult::fault;
    for (std::size_t i = 0; i < arms_.size(); ++i) {
      const JointVector& tau = arms_[i].tau;
      if (!tau.allFinite()) return LawResult::fault;
      *context.arms[i].tau = tau;
    }
    return LawResult::ok;
  }

 private:
  using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  using RowMajorJacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor, 6, kMaxJoints>;

  // Data that must be copied, because the law's layout differs.
  struct ArmBuffers {
    RowMajor3 R_WE;
    RowMajorJacobian J_V_WE;
    JointVector tau;
  };
  struct InputBuffers {
    RowMajor3 rotation;
    Vector6 vector;
    double value = 0, rate = 0;
  };

  bool uses(unsigned what) const { return (law_.uses & what) != 0; }

  bool has_estimates(const ControlContext& context) const {
    return std::ranges::all_of(context.arms, [&](const OwnedArm& arm) {
      const ArmState& state = *arm.state;
      return (!uses(MULTIPANDA_USES_TAU_EXT) || state.tau_ext_hat.size() == state.q.size()) &&
             (!uses(MULTIPANDA_USES_TAU_J) || state.tau_J.size() == state.q.size()) &&
             (!uses(MULTIPANDA_USES_WRENCH) || state.has_wrench_estimate);
    });
  }

  void fill(const OwnedArm& arm, ArmBuffers& own, multipanda_c_arm& plain) const {
    const ArmState& state = *arm.state;
    ModelTerms& terms = *arm.terms;
    plain.n = static_cast<std::uint64_t>(state.q.size());
    plain.q = state.q.data();
    plain.dq = state.dq.data();
    if (uses(MULTIPANDA_USES_TAU_J)) plain.tau_J = state.tau_J.data();
    if (uses(MULTIPANDA_USES_TAU_EXT)) plain.tau_ext_hat = state.tau_ext_hat.data();
    if (uses(MULTIPANDA_USES_WRENCH)) plain.F_K_W_est = state.F_K_W_est.vector.data();
    if (uses(MULTIPANDA_USES_POSE)) {
      own.R_WE = terms.X_WE().rotation;
      plain.R_WE = own.R_WE.data();
      plain.p_WE = terms.X_WE().position.data();
    }
    if (uses(MULTIPANDA_USES_TWIST)) plain.V_WE = terms.V_WE().vector.data();
    if (uses(MULTIPANDA_USES_JACOBIAN)) {
      own.J_V_WE = terms.J_V_WE();
      plain.J_V_WE = own.J_V_WE.data();
    }
    if (uses(MULTIPANDA_USES_MASS)) plain.M = terms.M().data();  // symmetric
    if (uses(MULTIPANDA_USES_CORIOLIS)) plain.c = terms.c().data();
    if (uses(MULTIPANDA_USES_GRAVITY)) plain.g = terms.g().data();
    own.tau.setZero(state.q.size());
    plain.tau = own.tau.data();
  }

  static void fill(const Reference& input, InputBuffers& own, multipanda_c_set_point& plain) {
    switch (input.spec().quantity) {
      case Quantity::pose:
        own.rotation = input.pose().rotation;
        plain = {input.pose().position.data(), own.rotation.data(), input.twist().vector.data(),
                 input.acceleration().vector.data()};
        break;
      case Quantity::joints:
        plain = {input.joints().data(), nullptr, input.joint_velocity().data(),
                 input.joint_acceleration().data()};
        break;
      case Quantity::twist:
      case Quantity::wrench:
        own.vector = input.vector();
        plain = {own.vector.data(), nullptr, nullptr, nullptr};
        break;
      case Quantity::scalar:
        own.value = input.scalar();
        own.rate = input.scalar_rate();
        plain = {&own.value, nullptr, &own.rate, nullptr};
        break;
    }
  }

  LawResult call(multipanda_c_function function, ControlContext& context) {
    if (!has_estimates(context)) return LawResult::fault;
    std::ranges::fill(context.outputs, 0.0);
    for (std::size_t i = 0; i < arms_.size(); ++i) fill(context.arms[i], arms_[i], plain_arms_[i]);
    for (std::size_t i = 0; i < inputs_.size(); ++i) fill(context.inputs[i], inputs_[i], set_points_[i]);
    for (std::size_t i = 0; i < parameters_.size(); ++i)
      parameters_[i] = context.parameters->values(i).data();
    const multipanda_c_tick tick{.dt = context.dt,
                                 .time_s = context.time_s,
                                 .hand_speed = context.contact.hand_speed,
                                 .spring_force = context.contact.spring_force,
                                 .spring_moment = context.contact.spring_moment,
                                 .arms = plain_arms_.data(),
                                 .inputs = set_points_.data(),
                                 .parameters = parameters_.data(),
                                 .outputs = context.outputs.data(),
                                 .memory = memory_.data()};
    return function(&tick) == 0 ? LawResult::ok : LawResult::fault;
  }

  multipanda_c_law law_;
  std::vector<ArmBuffers> arms_;
  std::vector<multipanda_c_arm> plain_arms_;
  std::vector<InputBuffers> inputs_;
  std::vector<multipanda_c_set_point> set_points_;
  std::vector<const double*> parameters_;
  std::vector<double> memory_;
};

void check_version(const multipanda_c_laws& laws) {
  if (laws.version != MULTIPANDA_C_LAW_VERSION) {
    throw std::runtime_error(
        "its laws have version " + std::to_string(laws.version) +
        " of the C interface, this program has version " + std::to_string(MULTIPANDA_C_LAW_VERSION) +
        "; build it again with the package or header (core/plugin/c_law.h) of this program");
  }
  const std::array<std::pair<const char*, std::pair<std::size_t, std::size_t>>, 7> sizes{{
      {"multipanda_c_law", {laws.size_of_law, sizeof(multipanda_c_law)}},
      {"multipanda_c_parameter", {laws.size_of_parameter, sizeof(multipanda_c_parameter)}},
      {"multipanda_c_input", {laws.size_of_input, sizeof(multipanda_c_input)}},
      {"multipanda_c_output", {laws.size_of_output, sizeof(multipanda_c_output)}},
      {"multipanda_c_arm", {laws.size_of_arm, sizeof(multipanda_c_arm)}},
      {"multipanda_c_set_point", {laws.size_of_set_point, sizeof(multipanda_c_set_point)}},
      {"multipanda_c_tick", {laws.size_of_tick, sizeof(multipanda_c_tick)}},
  }};
  for (const auto& [name, size] : sizes) {
    if (size.first == size.second) continue;
    throw std::runtime_error(
        std::string("its ") + name + " has " + std::to_string(size.first) + " bytes, that of this program " +
        std::to_string(size.second) +
        "; build it again with the package or header (core/plugin/c_law.h) of this program");
  }
}

}  // namespace

std::vector<ControlletType> c_law_controllets(const multipanda_c_laws& laws) {
  check_version(laws);
  if (laws.law_count == 0 || laws.law_count > kMostEntries || laws.laws == nullptr) {
    throw std::runtime_error("it has " + std::to_string(laws.law_count) + " laws; expected 1 to " +
                             std::to_string(kMostEntries));
  }
  std::vector<ControlletType> types;
  for (const auto& law : std::span(laws.laws, laws.law_count)) {
    types.push_back({descriptor_of(law), [law](ArmModels models) -> std::unique_ptr<Controllet> {
                       return std::make_unique<CLaw>(law, models);
                     }});
  }
  return types;
}

}  // namespace multipanda
