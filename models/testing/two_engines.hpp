#pragma once

#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

// One arm in two independent engines, for tests: MuJoCo reads MJCF, Pinocchio URDF.
namespace multipanda::test {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Terms {
  std::vector<Pose> poses;           // of the requested frames, in the world
  std::vector<RowMatrix> jacobians;  // (6 x n), world axes, linear first
  Eigen::MatrixXd M;
  Eigen::VectorXd c, g;
};

// Every term agrees within 1e-9 [m, rad, kg m^2, N m] by quantity; round-off is about 1e-13.
void expect_equal(const Terms& a, const Terms& b);

class MujocoArm {
 public:
  explicit MujocoArm(const std::string& mjcf);
  ~MujocoArm();
  int joints() const;
  void place_base(const Pose& X_WB);  // of the body link0
  Terms terms(const Eigen::VectorXd& q, const Eigen::VectorXd& dq, const std::vector<std::string>& sites);

 private:
  struct Engine;
  std::unique_ptr<Engine> engine_;
};

class PinocchioArm {
 public:
  explicit PinocchioArm(const std::string& urdf);
  // A part of a robot: `joints` move, the others are fixed at `held` (default 0). `base` is the base.
  PinocchioArm(const std::string& urdf, const std::string& base, const std::vector<std::string>& joints,
               const std::map<std::string, double>& held);
  ~PinocchioArm();
  int joints() const;
  void place_base(const Pose& X_WB);
  Terms terms(const Eigen::VectorXd& q, const Eigen::VectorXd& dq, const std::vector<std::string>& frames);

 private:
  struct Engine;
  std::unique_ptr<Engine> engine_;
};

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  double normal() { return std::normal_distribution<double>()(engine_); }
  Pose pose();  // any rotation, within 2 m
  Eigen::VectorXd between(const JointVector& low, const JointVector& high);

 private:
  std::mt19937_64 engine_;
};

}  // namespace multipanda::test
