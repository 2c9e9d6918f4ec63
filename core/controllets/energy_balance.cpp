#include "core/controllets/energy_balance.hpp"

#include <string>
#include <utility>

namespace multipanda {

void EnergyBalance::start(const JointVector& q) {
  q_ = q;
  for (auto& tau : tau_) tau = JointVector::Zero(q.size());
  work_.fill(0);
  others_ = 0;
}

void EnergyBalance::close(const JointVector& q, const JointVector& tau_in_use) {
  const JointVector dq = q - q_;
  double sum = 0;
  for (std::size_t i = 0; i < kTorqueParts; ++i) sum += work_[i] = tau_[i].dot(dq);
  others_ = tau_in_use.size() == dq.size() ? tau_in_use.dot(dq) - sum : 0.0;
  q_ = q;
}

void TankBalance::start(std::span<const OwnedArm> arms, double tank_start_j, const TankLimits& limits) {
  for (std::size_t i = 0; i < arms_.size(); ++i) arms_[i].start(arms[i].q());
  force.start(tank_start_j, limits);
  impedance.start(tank_start_j, limits);
  created_ = 0;
}

void TankBalance::close(std::span<const OwnedArm> arms, double stored_j, ValveLaw law,
                        const TankLimits& limits) {
  for (std::size_t i = 0; i < arms_.size(); ++i) arms_[i].close(arms[i].q(), arms[i].state->tau_J_d);
  double spent = work(kSpringPart) + stored_j + work(kDampingPart) + work(kFeedforwardPart) +
                 work(kNullSpacePart) + work(kCoriolisPart);
  for (const auto& arm : arms_) spent += arm.work_of_others();
  impedance.give(spent);
  force.give(work(kForcePart) + work(kForceDampingPart));
  if (law == ValveLaw::paper) created_ += force.make_up(limits) + impedance.make_up(limits);
}

double TankBalance::work(TorquePart part) const {
  double sum = 0;
  for (const auto& arm : arms_) sum += arm.work(part);
  return sum;
}

double TankBalance::work_of_others() const {
  double sum = 0;
  for (const auto& arm : arms_) sum += arm.work_of_others();
  return sum;
}

void TankBalance::show(std::span<double> outputs, std::span<const OwnedArm> arms, const Shown& now,
                       double dt) const {
  const double per_s = 1.0 / dt;
  outputs[kGamma] = now.gamma;
  outputs[kAlphaForce] = now.alpha_f;
  outputs[kAlphaImpedance] = now.scale - 1;
  outputs[kForceTank] = force.energy();
  outputs[kImpedanceTank] = impedance.energy();
  double kinetic = 0;
  for (const OwnedArm& arm : arms) kinetic += 0.5 * arm.dq().dot(arm.terms->momentum());
  outputs[kStored] = kinetic + now.scale * now.energy + force.energy() + impedance.energy();
  outputs[kKinetic] = kinetic;
  for (std::size_t i = 0; i < kTorqueParts; ++i)
    outputs[kSpringPower + i] = work(static_cast<TorquePart>(i)) * per_s;
  outputs[kSetPointPower] = now.supplied * per_s;
  outputs[kOtherPower] = work_of_others() * per_s;
  outputs[kCreated] = created_;
}

JointVector EnergyBalance::sum() const {
  JointVector tau = tau_[0];
  for (std::size_t i = 1; i < kTorqueParts; ++i) tau += tau_[i];
  return tau;
}

SpecsAt<ParameterSpec, 0, kTankParameterCount> tank_parameters() {
  const auto energy = [](std::string name, double initial, double min, double max, std::string doc) {
    return ParameterSpec{.name = std::move(name),
                         .unit = "J",
                         .initial = {initial},
                         .min = min,
                         .max = max,
                         .doc = std::move(doc)};
  };
  return {spec_table<kTankParameterCount>(
      parameter_at<kValveLaw>(
          choice_parameter("valve_law", {"passive", "paper"},
                           "How gamma and alpha_f scale the force; 'paper', as printed, is not passive.")),
      parameter_at<kReach>({.name = "d_max_m",
                            .unit = "m",
                            .initial = {0.02},
                            .min = 0.001,
                            .max = 1,
                            .doc = "Width of gamma, which fades the force away from the last contact."}),
      parameter_at<kTankStart>(energy(
          "tank_start_j", 100, 0, 1000,
          "Initial energy of both tanks, clamped to their limits. The paper's K_p |F_d|^2 / 2 is above "
          "100 J for any force above 1 N.")),
      parameter_at<kTankMin>(energy("tank_min_j", 0, 0, 1000, "Minimum energy E_min.")),
      parameter_at<kTankMax>(
          energy("tank_max_j", 100, 0, 1000, "Maximum energy E_max; energy returned above it is lost.")),
      parameter_at<kTankClosing>(
          energy("tank_closing_j", 0.1, 0.01, 10, "Range above E_min over which the valves close.")))};
}

TankSettings tank_settings(const ParameterSet& parameters, std::size_t first) {
  const auto number = [&](TankParameter p) { return parameters.number(first + p); };
  return {static_cast<ValveLaw>(parameters.choice(first + kValveLaw)),
          number(kReach),
          number(kTankStart),
          {number(kTankMin), number(kTankMax), number(kTankClosing)}};
}

SpecsAt<OutputSpec, 0, kTankOutputCount> tank_outputs() {
  const auto power = [](const char* of, const char* doc) {
    return OutputSpec{"power_" + std::string(of) + "_w", 1, doc};
  };
  // one for each TorquePart
  const SpecsAt<OutputSpec, kSpringPower, kTorqueParts> parts{
      {power("task_spring", "Power of the springs into the arms, mean of the last period."),
       power("task_damping", "The same for -D V."),
       power("feedforward",
             "The same for what is fed forward: (D + D_z) V_d, Lambda A_d, an object's weight."),
       power("nullspace", "The same for the null spaces."), power("coriolis", "The same for C dq."),
       power("force", "The same for F_f'."), power("force_damping", "The same for D_z.")}};
  return {spec_table<kTankOutputCount>(
      output_at<kGamma>("gamma_f", "gamma about the last contact."),
      output_at<kAlphaForce>("alpha_f", "Valve of the force tank."),
      output_at<kAlphaImpedance>("alpha_i",
                                 "Valve of the impedance tank: 0 keeps the springs, -1 removes them."),
      output_at<kForceTank>("force_tank_j", "Energy of the force tank."),
      output_at<kImpedanceTank>("impedance_tank_j", "Energy of the impedance tank."),
      output_at<kStored>("stored_energy_j", "Kinetic energy + springs + both tanks."),
      output_at<kKinetic>("kinetic_energy_j", "Kinetic energy of the arms."), parts,
      output_at<kSetPointPower>("power_set_point_w",
                                "Power into the springs by changes of set-points, stiffness and valve."),
      output_at<kOtherPower>("power_other_w", "Power into the arms by features and limits."),
      output_at<kCreated>("energy_injected_j", "Valve law 'paper': energy that empty tanks supplied."))};
}

}  // namespace multipanda
