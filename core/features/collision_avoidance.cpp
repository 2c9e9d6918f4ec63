#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "core/features/bounded_drive.hpp"
#include "core/features/builtins.hpp"
#include "core/features/collision_pairs.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

constexpr double kNothingNear = 10;  // [m]; output if no pair is nearer
// A hull around a base is wider than the body. Nearer to one than this share of the range, where the force is
// four times its slope times the range and more, an arm would be pushed away fast when the feature is
// switched on.
constexpr double kClearShare = 0.2;

// The damping of an approach is at most this, times the mass that it acts on. A damping D answers a velocity
// some milliseconds late (sampling, delay and lag of the torque); on a mass m that stays without overshoot up
// to D / m = 1 / (e T), 92 1/s for T = 4 ms.
constexpr double kDampingRate = 100;  // [1/s]

// Largest push of a pair, over spring_force: as much again as a law may press with.
constexpr double kMostOfPair = 2;

// With x = 1 - d/r: F/(k r) = h(x) = x / (1 - x), V/(k r^2) = -x - ln(1 - x): a spring of stiffness k at the
// edge of the range that stiffens without limit towards contact. From x = kHard on it follows its tangent, so
// that force and stiffness stay bounded even if bodies overlap.
constexpr double kHard = 0.8;
struct Wall {
  double force, potential, slope;  // h, its integral, its derivative
};
Wall wall(double x) {
  const double s = std::min(x, kHard), over = x - s;
  const double force = s / (1 - s), slope = 1 / ((1 - s) * (1 - s));
  return {force + slope * over, -s - std::log1p(-s) + force * over + 0.5 * slope * over * over, slope};
}

// Repulsion between bodies that could collide: the feature's own arms with each other, with themselves, with
// the arms of other owners and with the fixed obstacles of the scene. For a pair at distance d below the
// range r, x = 1 - d/r, n the unit vector from B's to A's closest point and v_n the rate at which the gap
// closes:
//   V = k r^2 (-x - ln(1 - x)),   F = -dV/dd + D x max(v_n, 0) = k r x/(1 - x) + D x max(v_n, 0),
//   tau_A += J_A^T n F,   tau_B -= J_B^T n F,   J the Jacobians of the closest points.
// The stiffness is k at the edge of the range and increases towards contact; beyond x = 0.8 the force follows
// its tangent, so that it stays bounded. Arms of other owners are not pushed: their own feature does that.
// Within bounds for contact -dV/dd is at most twice spring_force, and an arm gets of all its pairs together
// what BoundedDrive leaves. The damping of its own approach comes on top; that of another arm's approach
// would drive it away, and counts as the potential does.
class CollisionAvoidance final : public Feature {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "collision_avoidance",
            .doc =
                "Pushes arms softly away from each other, from themselves and from fixed obstacles, below a "
                "given "
                "distance.",
            .parameters = spec_table<kParameterCount>(
                parameter_at<kRange>({.name = "range_m",
                                      .unit = "m",
                                      .initial = {0.05},
                                      .min = 0.005,
                                      .max = 0.3,
                                      .doc = "Distance at which the repulsion begins."}),
                parameter_at<kStiffness>(
                    {.name = "stiffness_n_per_m",
                     .unit = "N/m",
                     .initial = {1000.0},
                     .max = 1000,  // a stiffer one lets go of an arm faster than that may move, and loses it
                     .doc = "Slope of the repulsive force of each pair at the edge of the range; it "
                            "increases towards contact."}),
                parameter_at<kDamping>(
                    {.name = "damping_n_s_per_m",
                     .unit = "N s/m",
                     .initial = {150.0},
                     .max = 1000,
                     .doc = "Largest damping of an approach, at contact; grows from zero at the edge of the "
                            "range. Less where the arm is light: 100 1/s times its effective mass."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kSmallest>("smallest_distance_m",
                                     "Smallest distance of all checked pairs [m]; 10 if none is nearer."),
                output_at<kActive>("active_pairs", "Number of pairs within the range."),
                output_at<kPotential>("potential_j", "Repulsive potential of all pairs [J]."),
                output_at<kLargestForce>("largest_force_n", "Largest repulsive force of a pair [N]."))};
  }

  explicit CollisionAvoidance(const FeatureContext& context)
      : pairs_(context), own_(context.own.begin(), context.own.end()) {
    slot_.fill(kNotOwn);
    for (std::size_t i = 0; i < context.own.size(); ++i) slot_[context.own[i]] = i;
    name_conditions();
    if (pairs_.size() > 0) return;
    // Without a pair it would have no effect.
    refusal_ =
        "there is nothing to keep apart: arm '" + context.arms[context.own[0]]->name() +
        "' has no collision shapes, or nothing that they could meet; give its model 'self_collision', or "
        "remove the feature";
  }

  std::string_view refusal() const override { return refusal_; }
  std::string_view start_condition() const override {
    if (conditions_.empty()) return {};
    return conditions_[too_near_.load(std::memory_order_acquire)];
  }
  LawResult start(ControlContext& context) override {
    if (!refusal_.empty()) return LawResult::fault;
    if (!conditions_.empty()) too_near_.store(0, std::memory_order_release);
    pairs_.place(context.scene_arms);
    const double clear = kClearShare * context.parameters->number(kRange);
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (!pairs_.has_base_hull(i) || !(pairs_.at_least(i) < clear)) continue;
      if (!(pairs_.closest(i).distance < clear)) continue;
      too_near_.store(condition_of_[i], std::memory_order_release);
      return LawResult::fault;
    }
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const double range = parameters.number(kRange), reach = range + CollisionPairs::kMostLowered;
    for (const OwnedArm& arm : context.arms) {
      if (!arm.q().allFinite() || !arm.dq().allFinite()) return LawResult::fault;
    }
    pairs_.place(context.scene_arms);
    factored_ = {};
    for (std::size_t k = 0; k < context.arms.size(); ++k) {
      drive_[k].setZero(context.arms[k].q().size());
      braking_[k] = drive_[k];
    }
    // The nearest pair of the last cycle gives a bound that rules out most other pairs. A bound that is not a
    // number belongs to an arm with an unknown state: its pairs are left out, in both places.
    double smallest = kNothingNear;
    if (pairs_.size() > 0 && pairs_.at_least(nearest_) < smallest) {
      smallest = std::min(smallest, pairs_.closest(nearest_).distance);
    }
    active_ = 0;
    potential_ = largest_force_ = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (!(pairs_.at_least(i) < std::max(reach, smallest))) continue;
      const Closest closest = pairs_.closest(i);
      if (closest.distance < smallest) {
        smallest = closest.distance;
        nearest_ = i;
      }
      if (!(closest.distance < reach)) continue;
      const Closest smooth = pairs_.smooth(i, closest);
      if (smooth.distance < range) repel(context, i, smooth, parameters);
    }
    for (std::size_t k = 0; k < context.arms.size(); ++k) {
      const JointMatrix* factor = active_ > 0 ? factor_of(context, own_[k]) : nullptr;
      if (factor == nullptr) {
        bounded_[k] = {};
        drive_[k].setZero();
      } else {
        const JointVector* law = context.scene_arms[own_[k]].tau;
        drive_[k] = bounded_[k].limit(context, context.arms[k], drive_[k], *factor, law);
      }
      *context.arms[k].tau += braking_[k] + drive_[k];
    }
    context.outputs[kSmallest] = smallest;
    context.outputs[kActive] = active_;
    context.outputs[kPotential] = potential_;
    context.outputs[kLargestForce] = largest_force_;
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kRange, kStiffness, kDamping, kParameterCount };
  enum Output : std::size_t { kSmallest, kActive, kPotential, kLargestForce, kOutputCount };
  static constexpr std::size_t kNotOwn = static_cast<std::size_t>(-1);

  void name_conditions() {
    const std::string general =
        "no arm may be nearer to a hull around a base than a fifth of range_m when it is switched on, since "
        "hulls are wider than the bodies and would push it away; move it away first, or give its model "
        "'self_collision'";
    condition_of_.assign(pairs_.size(), 0);
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (!pairs_.has_base_hull(i)) continue;
      if (conditions_.empty()) conditions_.push_back(general);
      condition_of_[i] = conditions_.size();
      const auto [a, b] = pairs_.pair(i);
      conditions_.push_back(pairs_.body(a).name + " and " + pairs_.body(b).name +
                            " were too near: " + general);
    }
  }

  // J^T n (n x 1) of a point of a body: its velocity along n per joint velocity. Empty if the body is fixed.
  static JointVector along_normal(ControlContext& context, const CollisionPairs::Body& body,
                                  const Vector3& p_W, const Vector3& n) {
    if (body.joint < 0) return {};
    Vector6 along = Vector6::Zero();
    along.head<3>() = n;
    return context.scene_arms[body.arm].terms->torque_of(static_cast<std::size_t>(body.joint), p_W, along);
  }

  void repel(ControlContext& context, std::size_t i, const Closest& closest, const ParameterSet& parameters) {
    const auto& a = pairs_.body(pairs_.pair(i).a);
    const auto& b = pairs_.body(pairs_.pair(i).b);
    const JointVector to_a = along_normal(context, a, closest.p_A, closest.normal);
    const JointVector to_b = along_normal(context, b, closest.p_B, closest.normal);
    const double v_a = speed_along(context, a.arm, to_a), v_b = speed_along(context, b.arm, to_b);
    const double closing = std::max(0.0, v_b - v_a);
    const double range = parameters.number(kRange), stiffness = parameters.number(kStiffness);
    const double x = 1 - closest.distance / range;
    const Wall w = wall(x);
    const double spring = std::min(stiffness * range * w.force, kMostOfPair * context.contact.spring_force);
    const bool itself = a.arm == b.arm && to_a.size() > 0 && to_b.size() > 0;
    double damping = 0;
    if (closing > 0) {
      const double mobility =
          itself ? mobility_along(context, a.arm, to_a - to_b)
                 : mobility_along(context, a.arm, to_a) + mobility_along(context, b.arm, to_b);
      const double most = mobility > 0 ? kDampingRate / mobility : 0;
      damping = std::min(parameters.number(kDamping), most) * std::min(x, 1.0);
    }
    push(a.arm, to_a, spring, damping, closing, itself ? closing : -v_a);
    push(b.arm, -to_b, spring, damping, closing, itself ? closing : v_b);
    active_ += 1;
    potential_ += stiffness * range * range * w.potential;
    largest_force_ = std::max(largest_force_, spring + damping * closing);
  }

  // An arm of another owner whose velocity is unknown counts as resting.
  static double speed_along(ControlContext& context, ArmIndex arm, const JointVector& along) {
    if (along.size() == 0) return 0;
    const double speed = along.dot(context.scene_arms[arm].dq());
    return std::isfinite(speed) ? speed : 0;
  }

  // The factor of the arm's mass matrix, or nullptr for an arm whose state is unknown now.
  const JointMatrix* factor_of(ControlContext& context, ArmIndex arm) {
    ModelTerms& terms = *context.scene_arms[arm].terms;
    if (!factored_.contains(arm)) {
      if (!terms.q().allFinite() || !cholesky_factor(terms.M(), factor_[arm])) return nullptr;
      factored_ |= ArmSet::of(arm);
    }
    return &factor_[arm];
  }

  // n^T J M^-1 J^T n: one over the effective mass along n at the point [1/kg]. Zero for an arm whose state is
  // unknown now: it counts as immovable.
  double mobility_along(ControlContext& context, ArmIndex arm, const JointVector& along) {
    const JointMatrix* factor = along.size() == 0 ? nullptr : factor_of(context, arm);
    if (factor == nullptr) return 0;
    Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, kMaxJoints> row = along.transpose();
    divide_by_transposed_lower(*factor, row);
    const double mobility = row.squaredNorm();
    return std::isfinite(mobility) ? mobility : 0;
  }

  // `away`: J^T n of its point, empty if its body is fixed. `own`: the rate at which the arm itself closes.
  void push(ArmIndex arm, const JointVector& away, double spring, double damping, double closing,
            double own) {
    if (away.size() == 0 || slot_[arm] == kNotOwn) return;
    const double braked = std::clamp(own, 0.0, closing);
    drive_[slot_[arm]] += (spring + damping * (closing - braked)) * away;
    braking_[slot_[arm]] += damping * braked * away;
  }

  CollisionPairs pairs_;
  std::vector<ArmIndex> own_;                          // arms in context.arms
  std::array<std::size_t, kMaxArms> slot_;             // of each arm in context.arms
  std::array<JointMatrix, kMaxArms> factor_;           // of each arm's mass matrix, lower half
  ArmSet factored_;                                    // arms whose factor is up to date
  std::array<JointVector, kMaxArms> drive_, braking_;  // of all pairs, on each of context.arms
  std::array<BoundedDrive, kMaxArms> bounded_;
  std::size_t nearest_ = 0;
  double active_ = 0, potential_ = 0, largest_force_ = 0;
  std::string refusal_;
  // Conditions for a start: in general, then for each pair with a hull around a base. Empty: no hulls.
  std::vector<std::string> conditions_;
  std::vector<std::size_t> condition_of_;  // of each pair
  std::atomic<std::size_t> too_near_{0};   // the condition that the last refused start names
};

}  // namespace

FeatureType collision_avoidance_feature() { return feature_type<CollisionAvoidance>(); }

}  // namespace multipanda
