#include "sysid/excitation/excitation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

#include <fmt/format.h>

#include "core/types/statistics.hpp"

namespace multipanda {
namespace {

constexpr double kFineStep = 0.001;   // of the final check of the limits [s]
constexpr double kRandomStep = 0.01;  // of random motions [s]
constexpr std::size_t kPerPart = 16;  // samples of a period per harmonic
constexpr double kTighter = 0.98;     // scales the limits during the search, whose coarse samples miss the
                                      // peaks
constexpr double kFarther = 0.003;    // added to distances during the search [m]
constexpr double kWeight = 20;        // weight of an excess against the logarithm of the condition number
constexpr std::size_t kReportEvery = 2000;  // evaluations

double omega_of(const ExcitationMotion& motion) { return 2 * std::numbers::pi / motion.series.period_s; }

// State k of `count` evenly spaced ones over a period at full rate, after the ramp.
ExcitationMotion::Sample sample_of(const ExcitationMotion& motion, std::size_t k, std::size_t count) {
  return motion.at(motion.series.ramp_s +
                   motion.series.period_s * static_cast<double>(k) / static_cast<double>(count));
}

bool fits(const std::vector<LimitUse>& uses) {
  return std::all_of(uses.begin(), uses.end(), [](const auto& use) { return use.use <= 1; });
}

void scale(ExcitationMotion& motion, double factor) {
  // Centered on the middle, which is known to be free.
  Eigen::VectorXd x = coefficients_of(motion);
  const auto n = motion.q_start.size();
  const auto parts = static_cast<Eigen::Index>(motion.parts());
  for (Eigen::Index k = 0; k < parts; ++k) {
    x.head(n) += (1 - factor) * 0.5 * x.segment(n + (2 * k + 1) * n, n);
  }
  x.tail(x.size() - n) *= factor;
  motion = with_coefficients(motion, x);
}

// Rounded for the file: to a tenth of a milliradian.
ExcitationMotion rounded(const ExcitationMotion& motion) {
  const Eigen::VectorXd x = coefficients_of(motion);
  return with_coefficients(motion, x.unaryExpr([](double v) { return std::round(v * 1e4) / 1e4; }));
}

ExcitationMotion shape_of(const RobotDescription& robot, const ExcitationOptions& options) {
  ExcitationMotion shape;
  shape.q_start = robot.q_home;
  shape.series.period_s = options.period;
  shape.series.cycles = options.cycles;
  shape.series.ramp_s = options.ramp;
  shape.series.harmonic_count = options.parts - 1;
  return shape;
}

void check(const ExcitationOptions& options) {
  const auto refuse = [](const std::string& text) { throw std::invalid_argument("excitation: " + text); };
  if (options.parts < 1 || options.parts > kMaxHarmonics + 1) {
    refuse(fmt::format("{} harmonics; expected 1 to {}", options.parts, kMaxHarmonics + 1));
  }
  if (!(options.period >= 1 && options.cycles >= 1 && options.ramp >= Harmonic::kShortestRamp &&
        options.ramp <= options.period)) {
    refuse(fmt::format(
        "period {} s, {} cycles, ramp {} s; expected a period of at least 1 s, at least one cycle "
        "and a ramp of {} s to a period",
        options.period, options.cycles, options.ramp, Harmonic::kShortestRamp));
  }
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : bits_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(bits_() >> 11) * 0x1p-53;
  }

 private:
  std::mt19937_64 bits_;
};

ExcitationMotion draw_motion(const RobotDescription& robot, const MotionCheck& check,
                             const ExcitationOptions& options, Random& random) {
  const ExcitationMotion shape = shape_of(robot, options);
  const auto n = shape.q_start.size();
  const auto parts = static_cast<Eigen::Index>(options.parts);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n * (1 + 2 * parts));
  for (Eigen::Index k = 0; k < 2 * parts * n; ++k) x[n + k] = random.uniform(-1, 1);
  ExcitationMotion motion = with_coefficients(shape, x);
  // Each joint swings about its middle by a random fraction of its limits.
  JointVector low = JointVector::Zero(n), high = low, speed = low, bend = low;
  const std::size_t count = kPerPart * options.parts;
  for (std::size_t k = 0; k < count; ++k) {
    const auto s = sample_of(motion, k, count);
    low = k == 0 ? s.q : JointVector(low.cwiseMin(s.q));
    high = k == 0 ? s.q : JointVector(high.cwiseMax(s.q));
    speed = speed.cwiseMax(s.dq.cwiseAbs());
    bend = bend.cwiseMax(s.ddq.cwiseAbs());
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    const double middle = std::clamp(robot.q_home[i] + random.uniform(-0.5, 0.5), check.q_low()[i] + 0.2,
                                     check.q_high()[i] - 0.2);
    const double room = std::min(middle - check.q_low()[i], check.q_high()[i] - middle);
    const double factor = random.uniform(0.3, 0.95) *
                          std::min({2 * room / (high[i] - low[i]),
                                    options.limits.velocity_share * robot.limits.dq_max[i] / speed[i],
                                    options.limits.acceleration_share * robot.limits.ddq_max[i] / bend[i]});
    for (Eigen::Index k = 0; k < 2 * parts; ++k) x[n + k * n + i] *= factor;
    x[i] = middle - 0.5 * factor * (low[i] + high[i]);  // low, high: with a start at zero
  }
  return with_coefficients(shape, x);
}

}  // namespace

double condition_of(BaseCondition& condition, const ExcitationMotion& motion) {
  condition.begin();
  const std::size_t count = kPerPart * motion.parts();
  for (std::size_t k = 0; k < count; ++k) {
    const auto s = sample_of(motion, k, count);
    condition.add(s.q, s.dq, s.ddq);
  }
  return condition.value();
}

std::vector<ExcitationMotion> random_motions(const RobotDescription& robot,
                                             const ExcitationOptions& options) {
  check(options);
  const MotionCheck limits(robot, options.hand, options.limits);
  Random random(options.seed);
  std::vector<ExcitationMotion> motions;
  const std::size_t most = 50 * options.random_motions;
  for (std::size_t tried = 0; tried < most && motions.size() < options.random_motions; ++tried) {
    ExcitationMotion motion = draw_motion(robot, limits, options, random);
    for (int smaller = 0; smaller < 4; ++smaller, scale(motion, 0.7)) {
      if (!fits(limits.use(motion, 5 * kRandomStep)) || !fits(limits.use(motion, kRandomStep))) continue;
      motions.push_back(motion);
      break;
    }
  }
  if (motions.size() < options.random_motions) {
    throw std::runtime_error(
        fmt::format("excitation of '{}': of {} random motions only {} are within the limits; allow a "
                    "larger workspace or a smaller reach",
                    robot.name, most, motions.size()));
  }
  return motions;
}

Excitation optimize_excitation(const RobotDescription& robot, const ExcitationOptions& options) {
  const auto say = [&](const std::string& line) {
    if (options.progress) options.progress(line);
  };
  const std::vector<ExcitationMotion> drawn = random_motions(robot, options);
  const std::size_t threads = std::max<std::size_t>(1, options.threads);
  ExcitationLimits tighter = options.limits;
  for (double* share :
       {&tighter.velocity_share, &tighter.acceleration_share, &tighter.jerk_share, &tighter.torque_share}) {
    *share *= kTighter;
  }
  tighter.position_margin += 0.01;
  tighter.self_distance += kFarther;
  tighter.room_min.array() += kFarther;
  tighter.room_max.array() -= kFarther;
  std::vector<BaseCondition> conditions;
  std::vector<MotionCheck> checks;
  for (std::size_t k = 0; k < threads; ++k) {
    conditions.emplace_back(robot);
    checks.emplace_back(robot, options.hand, tighter);
  }

  Excitation best;
  best.parameters = conditions[0].parameters();
  std::vector<double> values(drawn.size());
  for_all(drawn.size(), threads,
          [&](std::size_t thread, std::size_t i) { values[i] = condition_of(conditions[thread], drawn[i]); });
  const auto first = std::min_element(values.begin(), values.end());
  best.motion = drawn[static_cast<std::size_t>(first - values.begin())];
  best.condition = best.random_best = *first;
  best.random_median = median(values);
  say(fmt::format("{} base parameters; condition numbers of {} random motions: best {:.1f}, median {:.1f}",
                  best.parameters, drawn.size(), best.random_best, best.random_median));

  // Search: logarithm of the condition number, plus what exceeds the (tighter) limits.
  const ExcitationMotion shape = best.motion;
  const auto n = shape.q_start.size();
  Eigen::VectorXd scales = Eigen::VectorXd::Constant(coefficients_of(shape).size(), 0.05);
  for (Eigen::Index part = 0; part < static_cast<Eigen::Index>(shape.parts()); ++part) {
    const double rate = omega_of(shape) * static_cast<double>(part + 1);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double swing = std::min({1.0, tighter.velocity_share * robot.limits.dq_max[i] / rate,
                                     tighter.acceleration_share * robot.limits.ddq_max[i] / (rate * rate)});
      scales[n + 2 * part * n + i] = scales[n + (2 * part + 1) * n + i] = 0.1 * swing;
    }
  }
  const std::size_t count = kPerPart * options.parts;
  const auto worth = [&](std::size_t thread, const Eigen::VectorXd& x, double& excess) {
    const ExcitationMotion motion = with_coefficients(shape, x);
    excess = 0;
    conditions[thread].begin();
    for (std::size_t k = 0; k < count; ++k) {
      const auto s = sample_of(motion, k, count);
      const auto next = sample_of(motion, k + 1, count);
      const double dt = motion.series.period_s / static_cast<double>(count);
      excess += checks[thread].excess(s, JointVector((next.ddq - s.ddq) / dt));
      conditions[thread].add(s.q, s.dq, s.ddq);
    }
    return std::log(conditions[thread].value()) + kWeight * excess;
  };
  const MotionCheck last_word(robot, options.hand, options.limits);
  const auto accept = [&](const ExcitationMotion& motion) {
    const double condition = condition_of(conditions[0], motion);
    if (condition >= best.condition) return;
    ExcitationMotion scaled = motion;
    for (int smaller = 0; smaller < 4; ++smaller, scale(scaled, 0.98)) {
      const ExcitationMotion candidate = rounded(scaled);
      if (!fits(last_word.use(candidate, kRandomStep)) || !fits(last_word.use(candidate, kFineStep)))
        continue;
      const double own = condition_of(conditions[0], candidate);
      if (own >= best.condition) return;
      best.motion = candidate;
      best.condition = own;
      return;
    }
  };

  Evolution search(coefficients_of(shape), scales, options.seed);
  Eigen::VectorXd leader;
  double leading = std::numeric_limits<double>::infinity();
  std::size_t reported = 0;
  while (best.evaluations < options.evaluations && !(options.stop && options.stop->load())) {
    const std::vector<Eigen::VectorXd> candidates = search.ask();
    values.assign(candidates.size(), 0);
    std::vector<double> excess(candidates.size());
    for_all(candidates.size(), threads,
            [&](std::size_t thread, std::size_t i) { values[i] = worth(thread, candidates[i], excess[i]); });
    search.tell(values);
    best.evaluations += candidates.size();
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (excess[i] > 0 || values[i] >= leading) continue;
      leading = values[i];
      leader = candidates[i];
    }
    if (best.evaluations / kReportEvery == reported) continue;
    reported = best.evaluations / kReportEvery;
    if (leader.size() > 0) accept(with_coefficients(shape, leader));
    say(fmt::format("{:6} of {} motions tried: condition number {:.1f}", best.evaluations,
                    options.evaluations, best.condition));
  }
  if (leader.size() > 0) accept(with_coefficients(shape, leader));
  best.use = last_word.use(best.motion, kFineStep);
  return best;
}

}  // namespace multipanda
