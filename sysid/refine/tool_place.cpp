#include "sysid/refine/tool_place.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "scene/build.hpp"

namespace multipanda {
namespace {

// Removes a part from a body in the link's frame by adding it with negative mass.
RigidBody without(const RigidBody& whole, const RigidBody& part) {
  return merged(whole, {-part.mass, part.com, -part.inertia});
}

// Identified links are often at the limit of physical consistency. This is the smallest change of
// inertia that makes one possible, with mass and center unchanged. Sigma = tr(I)/2 1 - I is the second moment
// of mass.
RigidBody nearest_physical(const RigidBody& body) {
  if (is_physical(body)) return body;
  constexpr double kThinnest = 1e-3;  // smallest spread of the mass along any direction [m]
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(0.5 * body.inertia.trace() * Matrix3::Identity() -
                                                      body.inertia);
  const Vector3 moments = solver.eigenvalues().cwiseMax(body.mass * kThinnest * kThinnest);
  const Matrix3 sigma = solver.eigenvectors() * moments.asDiagonal() * solver.eigenvectors().transpose();
  return {body.mass, body.com, sigma.trace() * Matrix3::Identity() - sigma};
}

// Differences that remain with correct tools: errors of the arms' models and noise.
constexpr double kPositionNoise = 1e-4, kForceNoise = 0.03, kMomentNoise = 0.008;  // [m], [N], [N m]
// Expected offsets of tools, and the steps for the slopes.
constexpr double kExpectedShift = 0.01, kExpectedTurn = 2 * std::numbers::pi / 180;  // [m], [rad]
constexpr double kShiftStep = 0.002, kTurnStep = std::numbers::pi / 180;             // [m], [rad]
constexpr int kSteps = 3;
constexpr double kEnough = 0.7;     // stop once a step leaves more than this fraction of the cost
constexpr Eigen::Index kParts = 6;  // of a place: shift, turn

double scale_of(const std::string& quantity) {
  if (quantity == "x_EE") return kPositionNoise;
  if (quantity == "F_EE") return kForceNoise;
  return quantity == "M_EE" ? kMomentNoise : 0;
}

ToolPlaces places_of(const Eigen::VectorXd& p) {
  ToolPlaces places(static_cast<std::size_t>(p.size() / kParts));
  for (Eigen::Index i = 0; i < p.size() / kParts; ++i) {
    places[static_cast<std::size_t>(i)] = {p.segment<3>(kParts * i), p.segment<3>(kParts * i + 3)};
  }
  return places;
}

// (real - sim) / scale for all arms; empty if it cannot be computed.
Eigen::VectorXd differences(std::span<const MeasuredLog> real, std::span<const MeasuredLog> sim,
                            const AlignOptions& options) {
  std::vector<double> all;
  if (real.size() != sim.size()) return {};
  for (std::size_t arm = 0; arm < real.size(); ++arm) {
    const AlignedPair pair = align(real[arm], sim[arm], options);
    const Eigen::Index samples = pair.t.size();
    if (samples == 0) return {};
    const auto pieces = std::max<Eigen::Index>(1, std::lround(pair.t[samples - 1] - pair.t[0]));
    for (std::size_t k = 0; k < quantities().size(); ++k) {
      const double scale = scale_of(quantities()[k].name);
      if (scale == 0) continue;
      const auto& series = pair.series[k];
      if (series.real.rows() == 0 || series.sim.rows() == 0) return {};
      for (Eigen::Index piece = 0; piece < pieces; ++piece) {
        const Eigen::Index begin = samples * piece / pieces, end = samples * (piece + 1) / pieces;
        const Eigen::RowVectorXd mean =
            (series.real - series.sim).middleRows(begin, end - begin).colwise().mean();
        // Errors of a run are the same in all its segments, so together they count as one.
        for (const double value : mean) all.push_back(value / scale / std::sqrt(static_cast<double>(pieces)));
      }
    }
  }
  return Eigen::Map<Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

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

RobotDescription with_flange(const RobotDescription& robot, const SceneArm& arm, const Pose& X_LF) {
  const Pose before = robot.flange.pose();
  RigidBody last = robot.links.back();
  const auto shift = [&](const RigidBody& body, const Pose& X_F) {
    last = without(merged(last, moved(body, before * X_F)), moved(body, X_LF * X_F));
  };
  if (arm.hand && robot.hand) shift(rigid_hand(*robot.hand), robot.hand->mount.pose());
  if (arm.tool.mass > 0) shift({arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C}, {});
  RobotDescription result = robot;
  if (last.mass > 0) result.links.back() = nearest_physical(last);
  result.flange.position = X_LF.position;
  // Without a rotation, the values stay exactly the same.
  if ((X_LF.rotation - before.rotation).norm() > 1e-12) result.flange.rpy = rpy_of(X_LF.rotation);
  return result;
}

std::optional<PlaceFit> fit_places(std::span<const MeasuredLog> real, const PlaceRuns& run,
                                   const AlignOptions& options) {
  const Eigen::Index count = kParts * static_cast<Eigen::Index>(real.size());
  Eigen::VectorXd step(count), expected(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const bool turn = i % kParts >= 3;
    step[i] = turn ? kTurnStep : kShiftStep;
    expected[i] = turn ? kExpectedTurn : kExpectedShift;
  }
  std::vector<ToolPlaces> candidates{places_of(Eigen::VectorXd::Zero(count))};
  for (Eigen::Index i = 0; i < count; ++i)
    candidates.push_back(places_of(step[i] * Eigen::VectorXd::Unit(count, i)));
  const auto logs = run(candidates);
  if (logs.size() < candidates.size()) return std::nullopt;
  Eigen::VectorXd r = differences(real, logs[0], options);
  if (r.size() == 0 || !r.allFinite()) return std::nullopt;
  Eigen::MatrixXd slopes(r.size(), count);  // of the simulation
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::VectorXd moved = differences(real, logs[static_cast<std::size_t>(i) + 1], options);
    if (moved.size() != r.size() || !moved.allFinite()) return std::nullopt;
    slopes.col(i) = (r - moved) / step[i];
  }
  const Eigen::VectorXd weight = expected.cwiseAbs2().cwiseInverse();
  const auto cost = [&](const Eigen::VectorXd& left, const Eigen::VectorXd& p) {
    return left.squaredNorm() + p.cwiseQuotient(expected).squaredNorm();
  };
  const Eigen::LDLT<Eigen::MatrixXd> normal(slopes.transpose() * slopes +
                                            Eigen::MatrixXd(weight.asDiagonal()));

  Eigen::VectorXd p = Eigen::VectorXd::Zero(count);
  PlaceFit fit{.places = {}, .before = cost(r, p), .after = cost(r, p), .runs = candidates.size()};
  for (int k = 0; k < kSteps; ++k) {
    const Eigen::VectorXd next = normal.solve(slopes.transpose() * (r + slopes * p));
    const auto one = run({places_of(next)});
    if (one.empty()) return std::nullopt;
    ++fit.runs;
    const Eigen::VectorXd left = differences(real, one[0], options);
    if (left.size() != r.size() || !(cost(left, next) < fit.after)) break;
    const bool enough = cost(left, next) > kEnough * fit.after;
    fit.after = cost(left, next);
    p = next;
    r = left;
    if (enough) break;
  }
  fit.places = places_of(p);
  return fit;
}

RobotDescription with_tool_place(const RobotDescription& robot, const SceneArm& arm, const ToolPlace& place) {
  const Pose X_FE = arm_config(arm).frames.X_FE;
  Pose moved_E;
  moved_E.position = place.shift;
  const double angle = place.turn.norm();
  if (angle > 0) moved_E.rotation = Eigen::AngleAxisd(angle, place.turn / angle).toRotationMatrix();
  return with_flange(robot, arm, robot.flange.pose() * X_FE * moved_E * X_FE.inverse());
}

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
    // The estimate also contains undeclared weight: its value at the start, in free air, is subtracted.
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
