#pragma once

#include <array>
#include <memory>

#include "core/model/arm_model.hpp"
#include "core/types/spatial.hpp"

// The reference: the cost of the libraries alone for seven joints, without the framework except for its plain
// data structures.
namespace multipanda::bench {

using Vector7 = Eigen::Matrix<double, 7, 1>;

// Rigid-body terms of one arm as Pinocchio computes them: J of the flange, M, nle, g.
class BarePinocchioTerms {
 public:
  explicit BarePinocchioTerms(const ArmModel& arm);
  ~BarePinocchioTerms();
  void compute(const Vector7& q, const Vector7& dq);

 private:
  struct Robot;
  std::unique_ptr<Robot> robot_;
};

// Two Cartesian impedances, written directly for two seven-joint arms with fixed sizes: the law of
// docs/controllets/impedance.md with its defaults, far from singular poses (no floor under the
// mobility), equal rotational stiffness about all axes, rotation errors below 150 degrees.
class BareDualImpedance {
 public:
  struct Gains {
    Vector3 translational_stiffness;  // [N/m]
    double rotational_stiffness = 0;  // [N m/rad]
    double damping_ratio = 1;
    double null_space_stiffness = 0;  // [N m/rad]
  };
  struct Input {  // of one arm
    Vector7 q, dq;
    Pose X_W_d;
    Vector6 V_d, A_d;
    Vector7 q_N;
  };
  // Arms must have seven joints.
  BareDualImpedance(const ArmModel& first, const ArmModel& second, const Pose& X_FE, const Gains& gains);
  ~BareDualImpedance();

  // Torques of both arms [N m].
  const std::array<Vector7, 2>& torques(const std::array<Input, 2>& inputs);

 private:
  struct Robot;
  std::array<std::unique_ptr<Robot>, 2> robots_;
  Pose X_FE_;
  Gains gains_;
  std::array<Vector7, 2> tau_;
};

}  // namespace multipanda::bench
