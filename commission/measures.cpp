#include "commission/measures.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "commission/limits.hpp"
#include "scene/build.hpp"

namespace multipanda::commission {

namespace {

constexpr double kSettle_s = 0.6, kRest_s = 0.2;
constexpr unsigned kEvery = 4;   // cycles per sample of a curve
constexpr double kPeak = 1.875;  // peak speed of a minimum-jerk motion over its mean speed

double duration_of(double way, double speed) { return kPeak * way / speed; }

JointVector joints_of(const ArmSample& sample, JointArray ArmSample::*quantity, std::size_t n) {
  return Eigen::Map<const Eigen::VectorXd>((sample.*quantity).data(), static_cast<Eigen::Index>(n));
}

JointVector resting_place(ArmsRun& run, ArmIndex arm) {
  return run.watch(kRest_s).mean(arm, &ArmSample::q, run.joint_count(arm));
}

void append(Track& track, const Track& more) {
  const double begin = track.empty() ? 0 : track.t.back();
  for (const double t : more.t) track.t.push_back(begin + t);
  for (std::size_t i = 0; i < more.arms.size(); ++i)
    track.arms[i].insert(track.arms[i].end(), more.arms[i].begin(), more.arms[i].end());
}

// Friction opposes the motion; at the same position out and back everything else is equal. The motion is
// symmetric in time, so both fast middle parts cover the same positions.
double friction_from(const Track& out, const Track& back, ArmIndex arm, std::size_t joint, double direction) {
  const auto mean_of = [&](const Track& way, double sign) {
    double sum = 0, weight = 0, peak = 0;
    for (const auto& s : way.arms[arm]) peak = std::max(peak, sign * s.dq[joint]);
    for (const auto& s : way.arms[arm]) {
      if (sign * s.dq[joint] < 0.7 * peak) continue;
      sum += s.tau_cmd[joint];
      weight += 1;
    }
    return weight > 0 ? sum / weight : 0;
  };
  return direction * (mean_of(out, direction) - mean_of(back, -direction)) / 2;
}

Json curve_of(const Track& track, ArmIndex arm, std::size_t joint, double q0, double goal, double way_s) {
  Json curve{{"t", Json::array()},
             {"q", Json::array()},
             {"tau", Json::array()},
             {"way_rad", goal},
             {"way_s", way_s}};
  for (std::size_t k = 0; k < track.t.size(); k += 5) {
    const ArmSample& s = track.arms[arm][k];
    curve["t"].push_back(std::round(1e4 * track.t[k]) / 1e4);
    curve["q"].push_back(std::round(1e7 * (s.q[joint] - q0)) / 1e7);
    curve["tau"].push_back(std::round(1e4 * s.tau_cmd[joint]) / 1e4);
  }
  return curve;
}

}  // namespace

Json list(const JointVector& values) {
  Json json = Json::array();
  for (const double value : values) json.push_back(value);
  return json;
}

double joint_motion_seconds(std::size_t joints) {
  return static_cast<double>(joints) * (2 * (duration_of(kJointStep_rad, kJointSpeed) + kSettle_s) + kRest_s);
}

JointMotionFigures measure_joint_motion(ArmsRun& run, ArmIndex arm) {
  const std::size_t n = run.joint_count(arm);
  const JointVector zero = JointVector::Zero(static_cast<Eigen::Index>(n));
  JointMotionFigures figures{
      .error_rad = zero, .moved_rad = zero, .friction_nm = zero, .curves = Json::array()};
  const auto limits = robot_of(run.scene().arms[arm]).limits;
  const double way_s = duration_of(kJointStep_rad, kJointSpeed);
  run.lead(arm, Law::joint);
  for (std::size_t j = 0; j < n; ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const JointVector q0 = resting_place(run, arm);
    const double direction = 2 * q0[i] > limits.q_min[i] + limits.q_max[i] ? -1 : 1;
    JointVector goal = q0;
    goal[i] += direction * kJointStep_rad;
    run.joint_goal(arm, goal, way_s);
    Track out = run.watch(way_s + kSettle_s, kEvery);
    run.joint_goal(arm, q0, way_s);
    const Track back = run.watch(way_s + kSettle_s, kEvery);
    const JointVector reached = run.q(arm, out.arms[arm].back());
    figures.error_rad[i] = std::abs(goal[i] - reached[i]);
    figures.moved_rad[i] = direction * (reached[i] - q0[i]);
    figures.friction_nm[i] = friction_from(out, back, arm, j, direction);
    append(out, back);
    for (const auto& sample : out.arms[arm]) {
      for (std::size_t k = 0; k < n; ++k) {
        if (k == j) continue;
        figures.others_rad =
            std::max(figures.others_rad, std::abs(sample.q[k] - q0[static_cast<Eigen::Index>(k)]));
      }
    }
    figures.curves.push_back(curve_of(out, arm, j, q0[i], direction * kJointStep_rad, way_s));
  }
  run.lead(arm, Law::hold);
  return figures;
}

CartesianFigures measure_cartesian_motion(ArmsRun& run, ArmIndex arm) {
  const std::size_t n = run.joint_count(arm);
  ModelTerms terms = run.terms(arm);
  const JointVector still = JointVector::Zero(static_cast<Eigen::Index>(n));
  const auto pose = [&](const JointVector& q) {
    terms.update(q, still);
    return terms.X_WE();
  };
  CartesianFigures figures;
  figures.curves = {{"t", Json::array()}, {"x", Json::array()}, {"y", Json::array()}, {"z", Json::array()}};
  run.lead(arm, Law::cartesian);
  const Pose X_start = pose(resting_place(run, arm));
  const double way_s = duration_of(kCartesianStep_m, kCartesianSpeed);
  double begin = 0;
  for (const Vector3& axis :
       {Vector3(Vector3::UnitZ()), Vector3(Vector3::UnitX()), Vector3(Vector3::UnitY())}) {
    for (const bool out : {true, false}) {
      Pose goal = X_start;
      if (out) goal.position += kCartesianStep_m * axis;
      run.pose_goal(arm, goal, way_s);
      const Track track = run.watch(way_s + kSettle_s, kEvery);
      for (std::size_t k = 0; k < track.t.size(); k += 5) {
        const Vector3 p = pose(run.q(arm, track.arms[arm][k])).position - X_start.position;
        figures.curves["t"].push_back(begin + track.t[k]);
        figures.curves["x"].push_back(p.x());
        figures.curves["y"].push_back(p.y());
        figures.curves["z"].push_back(p.z());
      }
      begin += track.t.back();
      const Vector6 off = pose_error(goal, pose(run.q(arm, track.arms[arm].back())));
      figures.error_m = std::max(figures.error_m, off.head<3>().norm());
      figures.error_rad = std::max(figures.error_rad, off.tail<3>().norm());
    }
  }
  run.lead(arm, Law::hold);
  return figures;
}

StopFigures measure_stop(ArmsRun& run, ArmIndex arm) {
  run.lead(arm, Law::joint);
  const JointVector q0 = resting_place(run, arm);
  const auto limits = robot_of(run.scene().arms[arm]).limits;
  JointVector goal = q0;
  goal[0] += 2 * q0[0] > limits.q_min[0] + limits.q_max[0] ? -kStopStep_rad : kStopStep_rad;
  const double way_s = duration_of(kStopStep_rad, kStopSpeed);
  run.joint_goal(arm, goal, way_s);
  (void)run.watch(way_s / 2);
  const double at = run.newest(arm).q[0];
  run.stop(arm);
  const Track after = run.watch(2 * kStopTime_s);
  constexpr double kRests = 0.005;  // [rad/s]: above the noise of a velocity
  StopFigures figures;
  for (std::size_t k = 0; k < after.t.size(); ++k) {
    const ArmSample& s = after.arms[arm][k];
    if (std::abs(s.dq[0]) > kRests) figures.time_s = after.t[k];
    figures.angle_rad = std::max(figures.angle_rad, std::abs(s.q[0] - at));
  }
  run.resume(arm);
  return figures;
}

DelayFigures lag_of(const std::vector<double>& x, const std::vector<double>& y, double period_s,
                    double longest_s) {
  DelayFigures best{.torque_delay_s = 0, .fit = -1};
  const auto margin = static_cast<std::size_t>(std::ceil(longest_s / period_s)) + 1;
  if (x.size() != y.size() || x.size() < 4 * margin) return best;
  const double count = static_cast<double>(x.size() - 2 * margin);
  for (double lag = -longest_s; lag <= longest_s + 1e-12; lag += period_s / 20) {
    double sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
    for (std::size_t k = margin; k < x.size() - margin; ++k) {
      const double at = static_cast<double>(k) - lag / period_s;
      const auto whole = static_cast<std::size_t>(at);
      const double part = at - static_cast<double>(whole);
      const double value = x[whole] + (part > 0 ? part * (x[whole + 1] - x[whole]) : 0);
      sx += value;
      sy += y[k];
      sxx += value * value;
      sxy += value * y[k];
      syy += y[k] * y[k];
    }
    const double cov = sxy - sx * sy / count, vx = sxx - sx * sx / count, vy = syy - sy * sy / count;
    const double fit = vx > 0 && vy > 0 && cov > 0 ? cov * cov / (vx * vy) : 0;
    if (fit > best.fit) best = {.torque_delay_s = lag, .fit = fit};
  }
  return best;
}

DelayFigures delay_without_friction(const DelayFigures& slow, const DelayFigures& fast) {
  // A lag at the end of the search range is not valid.
  const double most = std::max(std::abs(slow.torque_delay_s), std::abs(fast.torque_delay_s));
  return {.torque_delay_s = (4 * fast.torque_delay_s - slow.torque_delay_s) / 3,
          .fit = most > 0.95 * kLongestLag_s ? 0 : std::min(slow.fit, fast.fit)};
}

DelayFigures measure_delay(ArmsRun& run, ArmIndex arm) {
  constexpr std::size_t kJoint = 3;
  constexpr double kSwing_s = 2;  // of each period
  const std::size_t n = run.joint_count(arm);
  ModelTerms terms = run.terms(arm);
  const JointVector still = JointVector::Zero(static_cast<Eigen::Index>(n));
  const auto swing = [&](double amplitude, double period_s) {
    (void)resting_place(run, arm);
    run.wiggle(arm, kJoint, amplitude, period_s, kSwing_s / period_s);
    const double begin = run.newest(arm).q[kJoint];
    bool away = false;  // an arm that swings too far is stopped at once
    const Track track = run.watch(kSwing_s + period_s, 1, [&](const Track& so_far) {
      away = std::abs(so_far.arms[arm].back().q[kJoint] - begin) > 4 * kWiggle_rad;
      return away;
    });
    if (away) throw ArmLeft(fmt::format("joint 4 swung further than {:.3f} rad", 4 * kWiggle_rad));
    std::vector<double> sent, shown;
    for (const auto& sample : track.arms[arm]) {
      terms.update(run.q(arm, sample), still);
      sent.push_back(sample.tau_cmd[kJoint]);
      shown.push_back(sample.tau_J[kJoint] - terms.g()[static_cast<Eigen::Index>(kJoint)]);
    }
    const double period = track.t.size() > 1
                              ? (track.t.back() - track.t.front()) / static_cast<double>(track.t.size() - 1)
                              : 0.001;
    return lag_of(sent, shown, period, kLongestLag_s);
  };
  run.lead(arm, Law::joint);
  const DelayFigures slow = swing(kWiggle_rad, kWigglePeriod_s);
  const DelayFigures fast = swing(kWiggle_rad / 2, kWigglePeriod_s / 2);
  run.lead(arm, Law::hold);
  return delay_without_friction(slow, fast);
}

NoiseFigures measure_noise(ArmsRun& run, ArmIndex arm, double seconds) {
  const std::size_t n = run.joint_count(arm);
  const Track track = run.watch(seconds);
  const auto rms = [&](JointArray ArmSample::*quantity) {
    const JointVector mean = track.mean(arm, quantity, n);
    JointVector sum = JointVector::Zero(mean.size());
    for (const auto& sample : track.arms[arm]) sum += (joints_of(sample, quantity, n) - mean).cwiseAbs2();
    return JointVector((sum / static_cast<double>(track.t.size())).cwiseSqrt());
  };
  return {.q_rad = rms(&ArmSample::q), .dq_rad_per_s = rms(&ArmSample::dq), .tau_nm = rms(&ArmSample::tau_J)};
}

bool Reading::good() const {
  if (std::isnan(value)) return false;
  return at_least ? value >= limit : value <= limit;
}

std::string reading_text(const Json& json) {
  const auto arm = json["arm"].get<std::string>(), unit = json["unit"].get<std::string>();
  const std::string with_unit = unit.empty() ? "" : " " + unit;
  std::string line = fmt::format(
      "{}{}: {}{}", arm.empty() ? "" : arm + ": ", json["quantity"].get<std::string>(),
      json["value"].is_null() ? "not a number" : fmt::format("{:.3g}", json["value"].get<double>()),
      with_unit);
  if (!json["limit"].is_null())
    line += fmt::format(" ({} {:g}{})", json["at_least"].get<bool>() ? "at least" : "at most",
                        json["limit"].get<double>(), with_unit);
  return line + (json["good"].get<bool>() ? "" : "  NO-GO");
}

std::string to_string(Verdict verdict) {
  return verdict == Verdict::go ? "go" : verdict == Verdict::no_go ? "no-go" : "skipped";
}

void StepResult::fail(std::string what_found, std::string what_expected, std::string what_to_do) {
  if (verdict == Verdict::no_go) return;  // the first one counts
  verdict = Verdict::no_go;
  found = std::move(what_found);
  expected = std::move(what_expected);
  remedy = std::move(what_to_do);
}

void StepResult::add(Reading reading, const std::string& remedy_, const std::string& found_) {
  const std::string unit = reading.unit.empty() ? "" : " " + reading.unit;
  if (!reading.good()) {
    fail(fmt::format("{}{} is {:.3g}{}{}", reading.arm.empty() ? "" : "arm '" + reading.arm + "': ",
                     reading.quantity, reading.value, unit, found_.empty() ? "" : ", " + found_),
         fmt::format("{} {:g}{}", reading.at_least ? "at least" : "at most", reading.limit, unit), remedy_);
  }
  readings.push_back(std::move(reading));
}

void StepResult::at_most(const std::string& arm, const std::string& quantity, double value,
                         const std::string& unit, double limit, const std::string& what_to_do,
                         const std::string& what_found) {
  add({arm, quantity, value, unit, limit}, what_to_do, what_found);
}

void StepResult::at_least(const std::string& arm, const std::string& quantity, double value,
                          const std::string& unit, double limit, const std::string& what_to_do,
                          const std::string& what_found) {
  add({arm, quantity, value, unit, limit, true}, what_to_do, what_found);
}

void StepResult::show(const std::string& arm, const std::string& quantity, double value,
                      const std::string& unit) {
  readings.push_back({arm, quantity, value, unit, kShown});
}

Json to_json(const StepResult& result) {
  Json json{{"verdict", to_string(result.verdict)}, {"readings", Json::array()}, {"notes", result.notes}};
  for (const auto& reading : result.readings) {
    json["readings"].push_back({{"arm", reading.arm},
                                {"quantity", reading.quantity},
                                {"value", std::isfinite(reading.value) ? Json(reading.value) : Json()},
                                {"unit", reading.unit},
                                {"limit", std::isfinite(reading.limit) ? Json(reading.limit) : Json()},
                                {"at_least", reading.at_least},
                                {"good", reading.good()}});
  }
  if (result.verdict == Verdict::no_go) {
    json["found"] = result.found;
    json["expected"] = result.expected;
    json["remedy"] = result.remedy;
  }
  if (!result.measured.empty()) json["measured"] = result.measured;
  return json;
}

}  // namespace multipanda::commission
