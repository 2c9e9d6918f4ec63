#include "sysid/identification/identify.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include <fmt/format.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/identify_parts.hpp"
#include "sysid/identification/predict.hpp"

namespace multipanda {
namespace {

using Eigen::Index;

constexpr double kShortestTotal = 3.0;  // of all logs together [s]
constexpr double kShortestLog = 1.0;

JointVector root_mean(const Eigen::VectorXd& squares, double count) {
  return (squares / std::max(1.0, count)).cwiseSqrt();
}

// Samples between two fractions of the log's duration.
MeasuredLog part_of(const MeasuredLog& log, double from, double to) {
  const double begin = log.t[0] + from * log.duration(), end = log.t[0] + to * log.duration();
  const double *times = log.t.data(), *after = times + log.samples();
  const double* first = std::lower_bound(times, after, begin);
  const double* last = std::upper_bound(times, after, end);
  const Index at = first - times, count = last - first;
  MeasuredLog out;
  out.source = log.source;
  out.gravity_B = log.gravity_B;
  out.t = log.t.segment(at, count);
  out.q = log.q.middleRows(at, count);
  out.dq = log.dq.middleRows(at, count);
  out.tau = log.tau.middleRows(at, count);
  return out;
}

// The sigmoid that equals amplitude tanh(dq / 0.05).
JointFriction as_sigmoid(const JointVector& amplitude) {
  const JointVector one = JointVector::Ones(amplitude.size());
  return {2 * amplitude, 2 / 0.05 * one, 0 * one};
}

void put_friction(const Fit& fit, const std::vector<FrictionPart>& parts, const Family& family,
                  const std::optional<JointFriction>& table, RobotDescription& robot) {
  const auto n = static_cast<Index>(robot.joint_count());
  const JointVector gain = JointVector::Ones(n) + fit.gain;
  TorqueSensor sensor = robot.torque_sensor.value_or(TorqueSensor{});
  sensor.gain = family.gains ? gain : JointVector();
  sensor.offset = JointVector();
  FrictionLaw law;
  for (const std::size_t p : family.parts) {
    const JointVector shown = fit.friction.col(static_cast<Index>(p));
    const JointVector amplitude = shown.cwiseQuotient(gain);
    switch (parts[p].kind) {
      case FrictionKind::offset:
        sensor.offset = shown;
        break;
      case FrictionKind::viscous:
        law.viscous = amplitude;
        break;
      case FrictionKind::stribeck:
        law.stribeck = amplitude;
        break;
      case FrictionKind::presliding:
        law.presliding.push_back({parts[p].distance, amplitude});
        break;
      case FrictionKind::coulomb:
        law.sigmoid = as_sigmoid(amplitude);
        break;
      case FrictionKind::sigmoid:
        law.sigmoid = {amplitude, table->p2, table->p3};
        break;
      case FrictionKind::initial:
      case FrictionKind::acceleration:
        break;  // not part of the model format
    }
  }
  const bool friction =
      law.viscous.size() > 0 || law.stribeck.size() > 0 || !law.presliding.empty() || law.sigmoid;
  robot.link_friction = friction ? std::optional(law) : std::nullopt;
  const bool sensor_known = sensor.gain.size() > 0 || sensor.offset.size() > 0 || sensor.noise > 0;
  robot.torque_sensor = sensor_known ? std::optional(sensor) : std::nullopt;
}

// Holds parameters that do not affect a level arm's torque at the prior. Otherwise, with a tilt of a few
// mrad, the center of mass of the first link would absorb other errors.
Eigen::VectorXd held_at_prior(const Eigen::VectorXd& prior, const BaseParameters& base) {
  constexpr double kWeight = 10, kSize = 0.1;  // [-], of a link [m]
  Eigen::VectorXd out = Eigen::VectorXd::Zero(prior.size());
  for (const Index k : base.unidentifiable_entries) {
    const double mass = prior[k / 10 * 10];
    const double scale = mass * std::pow(kSize, k % 10 == 0 ? 0 : k % 10 < 4 ? 1 : 2);
    out[k] = kWeight / (scale * scale);
  }
  return out;
}

bool is_dissipative(const FrictionLaw& law) {
  const auto good = [](const JointVector& v) { return v.size() == 0 || v.minCoeff() >= 0; };
  return good(law.viscous) && good(law.stribeck) && (!law.sigmoid || good(law.sigmoid->p1)) &&
         std::all_of(law.presliding.begin(), law.presliding.end(),
                     [&](const auto& e) { return good(e.amplitude); });
}

// The linear fit of the chosen family, with intervals.
LinearFit linear_stage(std::span<const FilteredLog> logs, const Candidates& set, const Family& family,
                       const RobotDescription& robot, const IdentifyOptions& options) {
  LinearOptions linear;
  linear.hand = options.hand;
  if (options.tool) linear.tool = options.tool;
  linear.gravity_B = options.gravity_B;
  for (const std::size_t p : family.parts) linear.friction.push_back(set.parts[p]);
  std::vector<MotionData> data;
  for (const FilteredLog& log : logs) {
    data.push_back({log.kept_rows(log.q), log.kept_rows(log.dq), log.kept_rows(log.ddq),
                    log.kept_rows(log.tau), kept_friction(log, linear.friction, robot.friction),
                    log.gravity_B});
  }
  return fit_linear(data, robot, linear);
}

bool same_kinematics(const RobotDescription& a, const RobotDescription& b) {
  if (a.joint_count() != b.joint_count()) return false;
  for (std::size_t i = 0; i < a.joint_count(); ++i) {
    if (!a.joints[i].position.isApprox(b.joints[i].position, 1e-6) &&
        (a.joints[i].position - b.joints[i].position).norm() > 1e-6) {
      return false;
    }
    if ((a.joints[i].rpy - b.joints[i].rpy).norm() > 1e-6) return false;
  }
  return true;
}

}  // namespace

FilteredLogs filtered_logs(std::span<const MeasuredLog> logs, const RobotDescription& prior) {
  if (logs.empty()) throw LogRefused("no log to identify from");
  refuse_other_robot(logs, prior);
  FilteredLogs out;
  for (const MeasuredLog& log : logs) out.seconds += log.duration();
  if (out.seconds < kShortestTotal) {
    throw LogRefused(
        fmt::format("{}: {:.3g} s of data are too short; expected at least {:g} s of exciting motion, "
                    "preferably 10 s or more",
                    logs.front().source, out.seconds, kShortestTotal));
  }
  for (const MeasuredLog& log : logs) out.logs.push_back(filter_log(log, kShortestLog));
  return out;
}

void put_scores(const CrossValidation& validation, const Candidates& set, std::size_t joints, bool choose,
                Identification& out) {
  out.family = set.families[validation.chosen].name;
  for (std::size_t f = 0; choose && f < set.families.size(); ++f) {
    const Family& family = set.families[f];
    if (f == validation.chosen) {
      out.rmse_expected = expected_rmse(validation.rmse[f], validation.fit.spread, validation.folds);
    }
    out.scores.push_back({family.name, coefficient_count(family, joints), validation.rmse[f],
                          validation.mean[f], family.eligible, f == validation.chosen});
  }
}

void put_held_out(std::span<const MeasuredLog> logs, const EquationSource& source, FitProblem problem,
                  const Family& family, std::size_t folds, const std::function<void(FilteredLog&)>& prepare,
                  Identification& out) {
  const auto part = [&](double from, double to) {
    std::vector<FilteredLog> parts;
    for (const MeasuredLog& log : logs) {
      parts.push_back(filter_log(part_of(log, from, to), 0.5));
      prepare(parts.back());
    }
    return parts;
  };
  for (const auto& [from, to] : {std::pair{0.0, 2.0 / 3}, {0.0, 0.6}, {0.4, 1.0}, {1.0 / 3, 1.0}}) {
    double longest_test = 0;
    for (const MeasuredLog& log : logs)
      longest_test = std::max(longest_test, (1 - (to - from)) * log.duration());
    if (longest_test < 0.8) continue;
    const std::vector<FilteredLog> fitted = part(from, to);
    problem.travel = travel_of(fitted);
    const std::vector<Equations> blocks = equations_of(fitted, source, folds);
    const auto [fit, expected] =
        fit_and_expect(blocks, equations_of(fitted, source, folds, true), problem, family);
    const Equations train = stacked(blocks, [](std::size_t) { return true; });
    const Equations test = equations_of(from > 0 ? part(0, from) : part(to, 1), source, 1).front();
    out.cuts.push_back(
        {from, to, root_mean(squared_errors(train, problem, fit), static_cast<double>(train.front().rows)),
         root_mean(squared_errors(test, problem, fit), static_cast<double>(test.front().rows)),
         JointVector(expected)});
  }
  if (out.cuts.empty()) return;
  out.rmse_train = out.cuts.front().rmse_train;
  out.rmse_heldout = out.cuts.front().rmse_test;
}

void put_motion(std::span<const FilteredLog> logs, Identification& out) {
  for (const FilteredLog& log : logs) {
    const Eigen::VectorXd low = log.q.colwise().minCoeff(), high = log.q.colwise().maxCoeff(),
                          fast = log.dq.cwiseAbs().colwise().maxCoeff();
    const bool first = out.q_min.size() == 0;
    out.q_min = first ? low : Eigen::VectorXd(out.q_min.cwiseMin(low));
    out.q_max = first ? high : Eigen::VectorXd(out.q_max.cwiseMax(high));
    out.dq_max = first ? fast : Eigen::VectorXd(out.dq_max.cwiseMax(fast));
    const double rows_per_s = 0.1 / kProtocolStep;  // every 10th sample is kept
    out.repeated_after.push_back(static_cast<double>(repeated_after(log)) / rows_per_s);
  }
}

void put_predictions(std::span<const FilteredLog> logs, const RobotDescription& prior,
                     const IdentifyOptions& options, Identification& out) {
  struct Model {
    std::string name;
    RobotDescription robot;
    bool motor_friction = false;
    Eigen::VectorXd squares;
  };
  std::vector<Model> models{{"identified", out.robot}, {prior.name, prior}};
  if (prior.friction && !prior.link_friction) {
    models.push_back({prior.name + " with its friction table", prior, true});
  }
  for (const std::string& name : available_robots()) {
    if (name == prior.name) continue;
    RobotDescription other = load_robot(name);
    if (!same_kinematics(prior, other)) continue;
    if (options.hand && !other.hand) continue;
    models.push_back({name, std::move(other)});
  }
  PredictOptions how;
  how.hand = options.hand;
  if (options.tool) how.tool = options.tool;
  how.gravity_B = options.gravity_B;
  double count = 0;
  for (const FilteredLog& log : logs) {
    ResidualSeries series{log.source, log.t(log.kept), log.kept_rows(log.tau), {}, {}};
    count += static_cast<double>(series.t.size());
    for (std::size_t m = 0; m < models.size(); ++m) {
      how.motor_friction = models[m].motor_friction;
      const Eigen::MatrixXd predicted = model_torque(log, models[m].robot, how);
      const Eigen::VectorXd squares = (predicted - series.measured).colwise().squaredNorm().transpose();
      models[m].squares =
          models[m].squares.size() == 0 ? squares : Eigen::VectorXd(models[m].squares + squares);
      if (m == 0) series.predicted = predicted;
      if (m == 1) series.prior = predicted;
    }
    out.series.push_back(std::move(series));
  }
  out.rmse_all = root_mean(models[0].squares, count);
  for (std::size_t m = 1; m < models.size(); ++m) {
    const JointVector rmse = root_mean(models[m].squares, count);
    out.beside.push_back({models[m].name, rmse, rmse.mean()});
  }
}

Identification identify(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                        const IdentifyOptions& options) {
  if (options.payload) return identify_payload(logs, prior, options);
  Identification out;
  const FilteredLogs filtered = filtered_logs(logs, prior);
  out.seconds_used = filtered.seconds;
  const std::size_t n = prior.joint_count();
  std::vector<Vector3> gravities;
  for (const MeasuredLog& log : logs) gravities.push_back(log.gravity_B.value_or(options.gravity_B));
  const bool one_base = std::all_of(gravities.begin(), gravities.end(),
                                    [&](const Vector3& g) { return same_gravity(g, gravities.front()); });
  const Candidates set = candidates(prior.friction.has_value(), options.families, one_base);
  if (!one_base) {
    out.warnings.push_back(
        "the logs have different bases: tilt is not identified; an error of 0.2 degrees in one of them "
        "causes about 0.2 N m");
  }
  const EquationSource source{&prior, set.parts, options.gravity_B};
  const std::size_t folds = std::max<std::size_t>(3, options.folds);
  const std::vector<Equations> blocks = equations_of(filtered.logs, source, folds);
  const std::vector<Equations> alone = equations_of(filtered.logs, source, folds, true);
  const Equations all = stacked(blocks, [](std::size_t) { return true; });

  FitProblem problem{.parts = set.parts,
                     .prior = thetas_of(prior),
                     .travel = travel_of(filtered.logs),
                     .lambda = options.prior_weight};
  if (const auto body = known_body(prior, options.hand, options.tool)) problem.known = theta_of(*body);
  Eigen::VectorXd carried = problem.prior;
  carried.tail<10>() += problem.known;
  for (const FilteredLog& log : filtered.logs) {
    refuse_unexplained(log.source,
                       equations_of(std::span(&log, 1), {&prior, {}, options.gravity_B}, 1).front(), carried,
                       prior);
  }
  for (const MeasuredLog& log : logs) {
    const std::string found =
        misfit(log, prior, {.hand = options.hand, .tool = options.tool, .gravity_B = options.gravity_B});
    if (!found.empty()) out.warnings.push_back(found);
  }
  const BaseParameters base = base_parameters(prior, gravities);
  refuse_unexciting(condition_of(all, base.leading), out.warnings);
  for (std::size_t i = 0; i < n; ++i) {
    const RigidBody& link = prior.links[i + 1];
    out.prior_consistent.push_back(is_physical(link));
    problem.prior.segment<10>(10 * static_cast<Index>(i)) = theta_of(floored(link, kLeastSecondMoment));
    if (!is_physical(link)) {
      out.warnings.push_back(
          fmt::format("link{} of {} is not a physically possible body; the prior is the nearest one that is",
                      i + 1, prior.name));
    }
  }

  problem.hold = held_at_prior(problem.prior, base);

  const CrossValidation validation =
      cross_validate(blocks, alone, problem, set, options.choose, options.threads);
  const Family& family = set.families[validation.chosen];
  put_scores(validation, set, n, options.choose, out);
  put_motion(filtered.logs, out);
  if (options.choose)
    put_held_out(
        logs, source, problem, family, folds, [](FilteredLog&) {}, out);
  out.robot = prior;
  for (std::size_t i = 0; i < n; ++i) {
    out.robot.links[i + 1] = body_of(validation.fit.theta.segment<10>(10 * static_cast<Index>(i)));
  }
  out.robot.base_tilt = validation.fit.tilt;  // zero for several bases
  put_friction(validation.fit, set.parts, family, prior.friction, out.robot);
  out.consistent = std::all_of(out.robot.links.begin() + 1, out.robot.links.end(), &is_physical);
  out.dissipative = !out.robot.link_friction || is_dissipative(*out.robot.link_friction);
  const std::string note = fmt::format(
      "Identified from {:.1f} s of measured torque ({}{}), prior {}, family {}.", out.seconds_used,
      std::filesystem::path(logs.front().source).filename().string(),
      logs.size() > 1 ? fmt::format(" and {} more", logs.size() - 1) : "", prior.name, out.family);
  out.robot.origin["inertials"] = note;
  out.robot.identified_range = IdentifiedRange{out.q_min, out.q_max, out.dq_max, out.rmse_expected};
  out.linear = linear_stage(filtered.logs, set, family, out.robot, options);
  put_predictions(filtered.logs, prior, options, out);
  return out;
}

}  // namespace multipanda
