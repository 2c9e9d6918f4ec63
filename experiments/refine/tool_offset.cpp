#include "experiments/refine/tool_offset.hpp"

#include <algorithm>

#include <Eigen/Cholesky>

#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr double kPressing = 3;       // [N]
constexpr double kPosition = 0.0005;  // what differs in position for other reasons [m]
constexpr double kMoment = 0.03;      // ... in moments [N m]
constexpr Eigen::Index kEvery = 20;   // of samples at 1 kHz
constexpr std::size_t kLeast = 50;    // samples
constexpr double kMost = 0.02;        // [m]

const AlignedPair::Series* series(const AlignedPair& pair, const std::string& name) {
  for (std::size_t i = 0; i < quantities().size(); ++i) {
    const auto& one = pair.series[i];
    if (quantities()[i].name == name && one.real.rows() > 0 && one.sim.rows() > 0) return &one;
  }
  return nullptr;
}

Matrix3 cross(const Vector3& v) {
  Matrix3 S;
  S << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return S;
}

// What is left of a whole in the link's frame when a part is taken away: a part of negative mass is added.
RigidBody without(const RigidBody& whole, const RigidBody& part) {
  return merged(whole, {-part.mass, part.com, -part.inertia});
}

}  // namespace

std::optional<Vector3> tool_offset(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                                   const SceneArm& arm, const AlignOptions& options) {
  const Matrix3 R_FE = arm_config(arm).frames.X_FE.rotation;
  Matrix3 A = Matrix3::Zero();
  Vector3 b = Vector3::Zero();
  std::size_t used = 0;
  for (std::size_t k = 0; k < std::min(real.size(), sim.size()); ++k) {
    const AlignedPair pair = align(real[k], sim[k], options);
    const auto *x = series(pair, "x_EE"), *F = series(pair, "F_EE"), *M = series(pair, "M_EE");
    if (x == nullptr || F == nullptr || M == nullptr || real[k].quat_EE.rows() == 0) return std::nullopt;
    for (Eigen::Index i = 0; i < pair.t.size(); i += kEvery) {
      const Vector3 f = F->real.row(i).transpose(), f_sim = F->sim.row(i).transpose();
      if (f.norm() < kPressing || f_sim.norm() < kPressing) continue;
      const double t = real[k].t[0] + pair.t[i];
      const auto row = std::min<Eigen::Index>(
          std::lower_bound(real[k].t.data(), real[k].t.data() + real[k].t.size(), t) - real[k].t.data(),
          real[k].t.size() - 1);
      const auto q = real[k].quat_EE.row(row);
      const Matrix3 R_WF = Quaternion(q[0], q[1], q[2], q[3]).toRotationMatrix() * R_FE.transpose();
      const Vector3 along = -R_WF.transpose() * f.normalized() / kPosition;
      const double apart = f.normalized().dot((x->real.row(i) - x->sim.row(i)).transpose()) / kPosition;
      A += along * along.transpose();
      b += along * apart;
      const Matrix3 turning = -cross(f) * R_WF / kMoment;  // d x F = -F x d
      A += turning.transpose() * turning;
      b += turning.transpose() * (M->real.row(i) - M->sim.row(i)).transpose() / kMoment;
      ++used;
    }
  }
  if (used < kLeast) return std::nullopt;
  const Vector3 d = A.ldlt().solve(b);
  if (!d.allFinite() || d.norm() > kMost) return std::nullopt;
  return d;
}

RobotDescription with_tool_offset(const RobotDescription& robot, const SceneArm& arm, const Vector3& d) {
  const Pose X_LF = robot.flange.pose();
  Pose moved_flange = X_LF;
  moved_flange.position += X_LF.rotation * d;
  RigidBody last = robot.links.back();
  const auto shift = [&](const RigidBody& body, const Pose& X_F) {
    last = without(merged(last, moved(body, X_LF * X_F)), moved(body, moved_flange * X_F));
  };
  if (arm.hand && robot.hand) shift(rigid_hand(*robot.hand), robot.hand->mount.pose());
  if (arm.tool.mass > 0) shift({arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C}, {});
  if (!is_physical(last)) return robot;
  RobotDescription result = robot;
  result.links.back() = last;
  result.flange.position = moved_flange.position;
  return result;
}

}  // namespace multipanda
