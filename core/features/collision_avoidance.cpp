#include "core/features/collision_avoidance.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/features/collision_pairs.hpp"

namespace multipanda {
namespace {

constexpr double kNothingNear = 10;  // [m]; output if no pair is nearer

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
                     .max = 20000,
                     .doc = "Slope of the repulsive force of each pair at the edge of the range; it "
                            "increases towards contact."}),
                parameter_at<kDamping>(
                    {.name = "damping_n_s_per_m",
                     .unit = "N s/m",
                     .initial = {150.0},
                     .max = 1000,
                     .doc = "Damping of an approach at contact; grows from zero at the edge of the range."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kSmallest>("smallest_distance_m",
                                     "Smallest distance of all checked pairs [m]; 10 if none is nearer."),
                output_at<kActive>("active_pairs", "Number of pairs within the range."),
                output_at<kPotential>("potential_j", "Repulsive potential of all pairs [J]."),
                output_at<kLargestForce>("largest_force_n", "Largest repulsive force of a pair [N]."))};
  }

  explicit CollisionAvoidance(const FeatureContext& context) : pairs_(context) {
    slot_.fill(kNotOwn);
    for (std::size_t i = 0; i < context.own.size(); ++i) slot_[context.own[i]] = i;
  }

  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const double range = parameters.number(kRange);
    pairs_.place(context.scene_arms);
    // The nearest pair of the last cycle gives a bound that rules out most other pairs.
    double smallest = kNothingNear;
    if (pairs_.size() > 0) smallest = std::min(smallest, pairs_.closest(nearest_).distance);
    active_ = 0;
    potential_ = largest_force_ = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (pairs_.at_least(i) >= std::max(range, smallest)) continue;
      const Closest closest = pairs_.closest(i);
      if (closest.distance < smallest) {
        smallest = closest.distance;
        nearest_ = i;
      }
      if (closest.distance >= range) continue;
      repel(context, i, closest, parameters);
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
  using PointJacobian = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxJoints>;

  // J^T n (n x 1) of a point of a body: its velocity along n per joint velocity. Empty if the body is fixed.
  static JointVector along_normal(ControlContext& context, const CollisionPairs::Body& body,
                                  const Vector3& p_W, const Vector3& n) {
    if (body.joint < 0) return {};
    ModelTerms& terms = *context.scene_arms[body.arm].terms;
    PointJacobian J(3, static_cast<Eigen::Index>(terms.joint_count()));
    terms.point_jacobian(static_cast<std::size_t>(body.joint), p_W, J);
    return J.transpose().lazyProduct(n);
  }

  void repel(ControlContext& context, std::size_t i, const Closest& closest, const ParameterSet& parameters) {
    const auto& a = pairs_.body(pairs_.pair(i).a);
    const auto& b = pairs_.body(pairs_.pair(i).b);
    const JointVector to_a = along_normal(context, a, closest.p_A, closest.normal);
    const JointVector to_b = along_normal(context, b, closest.p_B, closest.normal);
    double opening = 0;  // rate of the distance [m/s]
    if (to_a.size() > 0) opening += to_a.dot(context.scene_arms[a.arm].dq());
    if (to_b.size() > 0) opening -= to_b.dot(context.scene_arms[b.arm].dq());
    const double range = parameters.number(kRange), stiffness = parameters.number(kStiffness);
    const double x = 1 - closest.distance / range;
    const Wall w = wall(x);
    const double damping = parameters.number(kDamping) * std::min(x, 1.0);
    const double force = stiffness * range * w.force + damping * std::max(-opening, 0.0);
    if (to_a.size() > 0) push(context, a.arm, force, to_a);
    if (to_b.size() > 0) push(context, b.arm, -force, to_b);
    active_ += 1;
    potential_ += stiffness * range * range * w.potential;
    largest_force_ = std::max(largest_force_, force);
  }

  void push(ControlContext& context, ArmIndex arm, double force, const JointVector& along) const {
    if (slot_[arm] != kNotOwn) *context.arms[slot_[arm]].tau += force * along;
  }

  CollisionPairs pairs_;
  std::array<std::size_t, kMaxArms> slot_;  // of each arm in context.arms
  std::size_t nearest_ = 0;
  double active_ = 0, potential_ = 0, largest_force_ = 0;
};

}  // namespace

FeatureType collision_avoidance_feature() { return feature_type<CollisionAvoidance>(); }

}  // namespace multipanda
