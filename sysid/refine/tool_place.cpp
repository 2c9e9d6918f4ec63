#include "sysid/refine/tool_place.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

#include "scene/build.hpp"
#include "sysid/refine/last_link.hpp"

namespace multipanda {
namespace {

// Differences that remain with correct tools: errors of the arms' models, and noise.
constexpr double kPositionNoise = 1e-4, kForceNoise = 0.03, kMomentNoise = 0.008;  // [m], [N], [N m]
// Expected offsets of tools, and the steps for the slopes.
constexpr double kExpectedShift = 0.01, kExpectedTurn = 2 * std::numbers::pi / 180;  // [m], [rad]
constexpr double kShiftStep = 0.002, kTurnStep = std::numbers::pi / 180;             // [m], [rad]
constexpr int kSteps = 3;
constexpr double kEnough = 0.7;     // a step that leaves more than this fraction of the cost is the last one
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

// real - sim for all arms, divided by the scales; of length 0 if it cannot be computed.
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
        // Errors of a run are the same in all its pieces, so together they count as one.
        for (const double value : mean) all.push_back(value / scale / std::sqrt(static_cast<double>(pieces)));
      }
    }
  }
  return Eigen::Map<Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

}  // namespace

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

}  // namespace multipanda
