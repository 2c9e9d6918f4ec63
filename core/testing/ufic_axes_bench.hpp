#pragma once

#include <deque>
#include <vector>

#include "core/controllets/builtins.hpp"
#include "core/testing/hybrid_force_bench.hpp"

// One arm under `ufic` with forces and moments along axes, for its tests.
namespace multipanda::ufic_axes_test {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using hybrid_force_test::kTool;
using hybrid_force_test::light_wrist;
using hybrid_force_test::Observer;
using hybrid_force_test::six;

struct Bench : hybrid_force_test::Bench {
  explicit Bench(const Pose& X_WB = {}, const TestArm& of = TestArm::make(7))
      : hybrid_force_test::Bench(X_WB, ufic_controllet(), of) {
    rig.state(0).tau_J_d = joint_constant(7, 0);
  }
  void select_all(const std::vector<int>& axes, bool on = true) {
    for (const int axis : axes) select(axis, on);
  }
  Vector6 of_axes() { return six(three("axes_force_n"), three("axes_moment_nm")); }
  double number(std::string_view output) { return rig.output(output)[0]; }
};

// Moves an arm by torques that act some periods late. The tanks book what is commanded.
class Late {
 public:
  explicit Late(Bench& bench, std::size_t periods = 3) : bench_(bench), sent_(periods, bench.rig.tau(0)) {}
  void move(const Vector6& on_arm) {
    const JointVector tau = bench_.rig.tau(0);
    sent_.push_back(tau);
    bench_.rig.state(0).tau_J_d = tau;
    bench_.rig.integrate(0.001, {sent_.front() - tau + bench_.rig.terms(0).J_V_WE().transpose() * on_arm}, 2);
    sent_.pop_front();
  }

 private:
  Bench& bench_;
  std::deque<JointVector> sent_;
};

inline Matrix6 both(const Matrix3& R) {
  Matrix6 turn = Matrix6::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R;
  return turn;
}

}  // namespace multipanda::ufic_axes_test
