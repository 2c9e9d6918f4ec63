#include <random>

#include "core/model/model_terms.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

constexpr int kDrawnPoses = 48;  // the home configuration and seeded ones over the range of every joint

JointVector drawn_pose(const ArmModel& model, int k, std::mt19937& engine) {
  JointVector q = model.q_home();
  const ArmLimits& limits = model.limits();
  for (Eigen::Index i = 0; k > 0 && i < q.size(); ++i) {
    const double share = static_cast<double>(engine()) / static_cast<double>(std::mt19937::max());
    q[i] = limits.q_min[i] + share * (limits.q_max[i] - limits.q_min[i]);
  }
  return q;
}

// 1 / (M^-1)_ii: the inertia that a torque of joint i alone accelerates while all other joints are free.
void keep_least(const JointMatrix& M, JointVector& least) {
  JointMatrix L;
  if (!cholesky_factor(M, L)) return;
  for (Eigen::Index i = 0; i < M.cols(); ++i) {
    const JointVector e = JointVector::Unit(M.cols(), i);
    least[i] = std::min(least[i], 1.0 / cholesky_solve(L, e)[i]);
  }
}

}  // namespace

const JointVector& ArmModel::least_inertia() const {
  std::call_once(least_->once, [this] {
    ModelTerms terms(std::shared_ptr<const ArmModel>(std::shared_ptr<void>(), this));
    terms.set_config({}, source_.tool, {});
    std::mt19937 engine(1);
    JointVector least = JointVector::Constant(static_cast<Eigen::Index>(joint_count_), 1e9);
    for (int k = 0; k < kDrawnPoses; ++k) {
      terms.update(drawn_pose(*this, k, engine), JointVector::Zero(least.size()));
      JointMatrix M = terms.M();
      if (source_.known_motor_inertia.size() == least.size()) M.diagonal() -= source_.known_motor_inertia;
      if (source_.motor_inertia.size() == least.size()) M.diagonal() += source_.motor_inertia;
      keep_least(M, least);
    }
    least_->inertia = least;
  });
  return least_->inertia;
}

}  // namespace multipanda
