#include "experiments/refine/tool_place.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

#include "experiments/refine/last_link.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

// What is left of the differences when the tools are where they are: errors of the arms' models, noise.
constexpr double kPosition = 1e-4, kForce = 0.03, kMoment = 0.008;  // [m], [N], [N m]
// What tools are expected to be off by, and by how much they are moved for the slopes.
constexpr double kExpectedShift = 0.01, kExpectedTurn = 2 * std::numbers::pi / 180;  // [m], [rad]
constexpr double kShiftStep = 0.002, kTurnStep = std::numbers::pi / 180;             // [m], [rad]
constexpr int kSteps = 3;
constexpr double kEnough = 0.7;     // a step that leaves more of the cost than this is the last one
constexpr Eigen::Index kParts = 6;  // of a place: shift, turn

double scale_of(const std::string& quantity) {
  if (quantity == "x_EE") return kPosition;
  if (quantity == "F_EE") return kForce;
  return quantity == "M_EE" ? kMoment : 0;
}

ToolPlaces places_of(const Eigen::VectorXd& p) {
  ToolPlaces places(static_cast<std::size_t>(p.size() / kParts));
  for (Eigen::Index i = 0; i < p.size() / kParts; ++i) {
    places[static_cast<std::size_t>(i)] = {p.segment<3>(kParts * i), p.segment<3>(kParts * i + 3)};
  }
  return places;
}

// real - sim, all arms, over the scales; of length 0 where it cannot be told.
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
        // Errors of a run are alike in all its pieces: together they count as one.
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
