#include "core/controllets/damping_design.hpp"

#include <gtest/gtest.h>

#include "core/testing/dense_algebra.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::damping_design_test {
namespace {

using test::Draw;

// A random inertia of a task: kg and kg m^2, coupled.
Matrix6 some_inertia(Draw& draw) {
  Matrix6 A;
  for (int i = 0; i < 36; ++i) A.data()[i] = draw.uniform(-1, 1);
  Vector6 scale;
  scale << 2, 2, 2, 0.2, 0.2, 0.2;
  return scale.asDiagonal() * (A * A.transpose() + 0.2 * Matrix6::Identity()) * scale.asDiagonal();
}

struct Mode {
  double omega, ratio;
};

// Modes of inertia x'' + damping x' + stiffness x = 0, from the eigenvalues of its first-order form.
std::vector<Mode> modes_of(const Eigen::MatrixXd& inertia, const Eigen::MatrixXd& damping,
                           const Eigen::MatrixXd& stiffness) {
  const Eigen::Index n = inertia.rows();
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(2 * n, 2 * n);
  A.topRightCorner(n, n).setIdentity();
  const Eigen::MatrixXd mobility = test::inverse(inertia);
  A.bottomLeftCorner(n, n) = -mobility * stiffness;
  A.bottomRightCorner(n, n) = -mobility * damping;
  const Eigen::VectorXcd poles = test::eigenvalues(A);
  std::vector<Mode> modes;
  for (Eigen::Index i = 0; i < poles.size(); ++i)
    modes.push_back({std::abs(poles[i]), -poles[i].real() / std::abs(poles[i])});
  return modes;
}

TEST(DampingDesign, GivesEveryCoupledModeItsRatio) {
  Draw draw(11);
  for (int trial = 0; trial < 50; ++trial) {
    const Matrix6 Lambda = some_inertia(draw);
    Vector6 k;
    k << draw.uniform(10, 2000), draw.uniform(10, 2000), draw.uniform(10, 2000), draw.uniform(1, 100),
        draw.uniform(1, 100), draw.uniform(1, 100);
    const Matrix6 K = k.asDiagonal();
    const double zeta = draw.uniform(0.2, 0.95);
    // A spring that acts 10 ms late needs the damping ratio 10 ms / 2 omega.
    for (const Mode& mode : modes_of(Lambda, task_damping(Lambda, K, zeta), K)) {
      if (mode.omega < 180) {
        EXPECT_NEAR(mode.ratio, std::max(zeta, 0.005 * mode.omega), 1e-6);
      }
    }
  }
}

TEST(DampingDesign, JointsOfAnyCount) {
  Draw draw(12);
  for (std::size_t n = 1; n <= kMaxJoints; ++n) {
    const auto size = static_cast<Eigen::Index>(n);
    JointMatrix A(size, size);
    for (Eigen::Index i = 0; i < A.size(); ++i) A.data()[i] = draw.uniform(-1, 1);
    const JointMatrix M = A * A.transpose() + 0.1 * JointMatrix::Identity(size, size);
    const JointVector K = draw.joints(n, 200) + joint_constant(n, 250);
    for (const Mode& mode :
         modes_of(M, coupled_damping(M, JointMatrix(K.asDiagonal()), 0.6), K.asDiagonal().toDenseMatrix())) {
      EXPECT_NEAR(mode.ratio, 0.6, 1e-6) << n << " joints";
    }
  }
}

// For any stiffness, also zero along a direction: symmetric, no negative power, D Lambda^-1 D = 4 zeta^2 K.
TEST(DampingDesign, NeverSuppliesEnergyAndAcceptsZeroStiffness) {
  Draw draw(13);
  for (int trial = 0; trial < 50; ++trial) {
    const Matrix6 Lambda = some_inertia(draw);
    Matrix6 G = Matrix6::Zero();  // of rank trial % 6
    for (int i = 0; i < 6 * (trial % 6); ++i) G.data()[i] = draw.uniform(-3, 3);
    const Matrix6 K = G * G.transpose();
    const Matrix6 D = task_damping(Lambda, K, 1.3);
    ASSERT_TRUE(D.allFinite());
    EXPECT_NEAR((D - D.transpose()).norm(), 0, 1e-9);
    for (int i = 0; i < 20; ++i) {
      const Vector6 v = Vector6::NullaryExpr([&] { return draw.uniform(-1, 1); });
      EXPECT_GE(v.dot(D * v), -1e-9);
    }
    const Matrix6 mobility = test::inverse(Lambda);
    EXPECT_NEAR((D * mobility * D - 4 * 1.3 * 1.3 * K).norm(), 0, 1e-6 * (1 + K.norm()));
  }
}

// The growth per period of x'' = -k x - d x', sampled at 1 kHz, `delay` periods late: spectral radius.
double growth(double k, double d, int delay) {
  constexpr double T = 1e-3;
  const Eigen::Index n = 2 * (delay + 1);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
  A(1, 1) = 1;  // of x, v and those of the periods before
  A(1, n - 2) -= T * k;
  A(1, n - 1) -= T * d;
  A.row(0) = T * A.row(1);
  A(0, 0) += 1;
  for (Eigen::Index i = 2; i < n; ++i) A(i, i - 2) = 1;
  return test::eigenvalues(A).cwiseAbs().maxCoeff();
}

TEST(DampingDesign, FastModesDecayBehindTwoPeriods) {
  int uncapped_that_grow = 0;
  for (const double zeta : {0.5, 0.7, 1.0, 1.5, 2.0}) {
    for (double w = 20; w <= 295; w += 5) {
      const double k = w * w;
      const double d = coupled_damping(JointMatrix(JointMatrix::Identity(1, 1)),
                                       JointMatrix(JointMatrix::Constant(1, 1, k)), zeta)(0, 0);
      EXPECT_NEAR(d, std::min(std::max(2 * zeta * w, 0.01 * k), kLargestModalDamping), 1e-9);
      EXPECT_LT(growth(k, d, 1), 1) << w << " rad/s, " << zeta;
      EXPECT_LT(growth(k, d, 2), 1) << w << " rad/s, " << zeta;
      if (w <= 205) {
        EXPECT_LT(growth(k, d, 3), 1) << w << " rad/s, " << zeta;
      }
      uncapped_that_grow += growth(k, 2 * zeta * w, 2) > 1;
    }
  }
  EXPECT_GT(uncapped_that_grow, 30);
}

TEST(DampingDesign, NoModeOfACoupledTaskGetsMore) {
  Draw draw(14);
  for (int trial = 0; trial < 50; ++trial) {
    const Matrix6 Lambda = some_inertia(draw);
    Matrix6 G = Matrix6::Zero();
    for (int i = 0; i < 36; ++i) G.data()[i] = draw.uniform(-2000, 2000);
    const Matrix6 D = task_damping(Lambda, G * G.transpose(), 1);
    const Eigen::VectorXd of_modes = test::eigenvalues(test::inverse(Lambda) * D).real();
    EXPECT_LE(of_modes.maxCoeff(), kLargestModalDamping * (1 + 1e-6));
    EXPECT_NEAR(of_modes.maxCoeff(), kLargestModalDamping, 1e-3);
  }
}

TEST(DampingDesign, NaNStaysNaN) {
  Matrix6 Lambda = Matrix6::Identity();
  Lambda(2, 2) = std::nan("");
  EXPECT_FALSE(task_damping(Lambda, Matrix6::Identity(), 1).allFinite());
}

}  // namespace
}  // namespace multipanda::damping_design_test
