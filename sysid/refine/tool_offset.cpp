#include "sysid/refine/tool_offset.hpp"

#include <algorithm>
#include <vector>

#include <Eigen/Cholesky>

#include "scene/build.hpp"
#include "sysid/refine/last_link.hpp"

namespace multipanda {
namespace {

constexpr double kPressing = 3;       // [N]
constexpr double kPosition = 0.0005;  // expected differences in position from other causes [m]
constexpr double kMoment = 0.03;      // the same for moments [N m]
constexpr Eigen::Index kEvery = 20;   // of samples at 1 kHz
constexpr std::size_t kLeast = 50;    // samples
constexpr double kExpected = 0.01;    // [m]
constexpr Eigen::Index kAir = 200;    // samples at the start
constexpr double kMost = 0.02;        // [m]

const AlignedPair::Series* series(const AlignedPair& pair, const std::string& name) {
  for (std::size_t i = 0; i < quantities().size(); ++i) {
    const auto& one = pair.series[i];
    if (quantities()[i].name == name && one.real.rows() > 0 && one.sim.rows() > 0) return &one;
  }
  return nullptr;
}

Vector6 in_free_air(const Eigen::MatrixXd& F) {
  return F.topRows(std::min(kAir, F.rows())).colwise().mean().transpose();
}

Matrix3 cross(const Vector3& v) {
  Matrix3 S;
  S << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return S;
}

}  // namespace

std::optional<Vector3> tool_offset(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                                   const SceneArm& arm, const AlignOptions& options,
                                   double compliance_m_per_n) {
  const Matrix3 R_FE = arm_config(arm).frames.X_FE.rotation;
  Matrix3 A = Matrix3::Zero();
  Vector3 b = Vector3::Zero();
  std::size_t used = 0;
  for (std::size_t k = 0; k < std::min(real.size(), sim.size()); ++k) {
    const AlignedPair pair = align(real[k], sim[k], options);
    const auto *x = series(pair, "x_EE"), *F = series(pair, "F_EE"), *M = series(pair, "M_EE");
    if (x == nullptr || F == nullptr || M == nullptr || real[k].quat_EE.rows() == 0) return std::nullopt;
    // The estimate also shows undeclared weight. Its value at the start, in free air, is not contact.
    const Vector3 air = in_free_air(real[k].F_EE).head(3), air_sim = in_free_air(sim[k].F_EE).head(3);
    const Vector3 air_moment = in_free_air(real[k].F_EE).tail(3) - in_free_air(sim[k].F_EE).tail(3);
    std::vector<Eigen::Index> pressed;
    Vector3 normal = Vector3::Zero();  // friction cancels over the motion, or is small
    for (Eigen::Index i = 0; i < pair.t.size(); i += kEvery) {
      const Vector3 f = F->real.row(i).transpose() - air, f_sim = F->sim.row(i).transpose() - air_sim;
      if (f.norm() < kPressing || f_sim.norm() < kPressing) continue;
      pressed.push_back(i);
      normal += f;
    }
    if (pressed.empty()) continue;
    normal.normalize();
    for (const Eigen::Index i : pressed) {
      const Vector3 f = F->real.row(i).transpose() - air, f_sim = F->sim.row(i).transpose() - air_sim;
      const double deeper = compliance_m_per_n * normal.dot(f - f_sim);
      const double t = real[k].t[0] + pair.t[i];
      const auto row = std::min<Eigen::Index>(
          std::lower_bound(real[k].t.data(), real[k].t.data() + real[k].t.size(), t) - real[k].t.data(),
          real[k].t.size() - 1);
      const auto q = real[k].quat_EE.row(row);
      const Matrix3 R_WF = Quaternion(q[0], q[1], q[2], q[3]).toRotationMatrix() * R_FE.transpose();
      const Vector3 along = -R_WF.transpose() * normal / kPosition;
      A += along * along.transpose();
      b += along * (normal.dot((x->real.row(i) - x->sim.row(i)).transpose()) - deeper) / kPosition;
      const Matrix3 turning = -cross(f) * R_WF / kMoment;  // d x F = -F x d
      const Vector3 moment = (M->real.row(i) - M->sim.row(i)).transpose() - air_moment;
      A += turning.transpose() * turning;
      b += turning.transpose() * moment / kMoment;
    }
    used += pressed.size();
  }
  if (used < kLeast) return std::nullopt;
  // Errors of a run are the same in all its samples, so together they count as one. Unidentifiable components
  // stay small.
  const auto count = static_cast<double>(used);
  const Vector3 d = (A / count + Matrix3::Identity() / (kExpected * kExpected)).ldlt().solve(b / count);
  if (!d.allFinite() || d.norm() > kMost) return std::nullopt;
  return d;
}

double surface_compliance(const Scene& scene) {
  std::optional<double> stiffness;
  for (const auto& object : scene.objects) {
    if (!object.contact) continue;
    if (stiffness && *stiffness != object.contact->stiffness_n_per_m) return 0;
    stiffness = object.contact->stiffness_n_per_m;
  }
  return stiffness ? 1 / *stiffness : 0;
}

RobotDescription with_tool_offset(const RobotDescription& robot, const SceneArm& arm, const Vector3& d) {
  Pose X_LF = robot.flange.pose();
  X_LF.position += X_LF.rotation * d;
  return with_flange(robot, arm, X_LF);
}

}  // namespace multipanda
