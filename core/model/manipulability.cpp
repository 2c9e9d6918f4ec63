#include "core/model/manipulability.hpp"

#include <array>
#include <cmath>

#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

constexpr double kRounding = 1e-12;  // eps; halves the inverse at a singular value of 1e-6

}  // namespace

void compute_manipulability(const Jacobian& J, Manipulability& result) {
  const Eigen::Index n = J.cols();
  const Matrix6 JJt = J.lazyProduct(J.transpose());
  Matrix6 L;
  cholesky_factor<Matrix6>(JJt + kRounding * Matrix6::Identity(), L);
  double m = 1;
  for (Eigen::Index i = 0; i < 6; ++i) m *= L(i, i);
  // With fewer than six joints, or at a singular pose, only eps remains.
  result.value = m;
  Matrix6 half = Matrix6::Identity();  // L^-T
  divide_by_transposed_lower(L, half);
  const Matrix6 inverse = half * half.transpose();
  result.J_dual.resize(6, n);
  result.J_dual.noalias() = inverse.lazyProduct(J);

  // tr(G dJ/dq_k J^T) = sum over j of (dJ_j/dq_k) . D_j with D = G J, D_j = [a_j; b_j].
  std::array<Vector3, kMaxJoints> before;  // sum over j < k of a_j x w_j
  Vector3 sum = Vector3::Zero();
  for (Eigen::Index k = 0; k < n; ++k) {
    before[static_cast<std::size_t>(k)] = sum;
    sum += Vector3(result.J_dual.col(k).head<3>()).cross(Vector3(J.col(k).tail<3>()));
  }
  result.gradient.resize(n);
  Vector3 from = Vector3::Zero();    // sum over j >= k of v_j x a_j
  Vector3 beyond = Vector3::Zero();  // sum over j > k of w_j x b_j
  for (Eigen::Index k = n - 1; k >= 0; --k) {
    const Vector3 v = J.col(k).head<3>(), w = J.col(k).tail<3>();
    const Vector3 a = result.J_dual.col(k).head<3>(), b = result.J_dual.col(k).tail<3>();
    from += v.cross(a);
    result.gradient[k] = m * (w.dot(from + beyond) + v.dot(before[static_cast<std::size_t>(k)]));
    beyond += w.cross(b);
  }
}

JointVector Manipulability::self_motion(const Jacobian& J, const JointVector& dq) const {
  const Eigen::Matrix<double, 6, 1> v = J.lazyProduct(dq);
  return dq - J_dual.transpose().lazyProduct(v);
}

}  // namespace multipanda
