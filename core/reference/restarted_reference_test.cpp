// A reference keeps nothing of an earlier run: started again, it gives bit by bit what a new one gives.
#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::restarted_reference_test {
namespace {

using test::Draw;

Reference reference_of(Quantity quantity) { return Reference({.name = "input", .quantity = quantity}, 7); }

void start(Reference& reference, Draw& draw) {
  if (reference.spec().quantity == Quantity::pose) {
    reference.start(draw.pose(0.5));
  } else if (reference.spec().quantity == Quantity::joints) {
    reference.start(draw.joints(7, 1));
  } else {
    const double value = draw.uniform(-1, 1);
    reference.start_constant(value);
    double values[kMaxTargetValues]{}, rates[kMaxTargetValues]{};
    reference.record(values, rates);
    for (std::size_t i = 0; i < reference.size(); ++i) EXPECT_EQ(values[i], value);
  }
}

Target near(const Reference& reference, Draw& draw, double reach) {
  const Quantity quantity = reference.spec().quantity;
  if (quantity == Quantity::pose) {
    const Pose X = reference.pose();
    return pose_target({exp_rotation(draw.vector3(reach)) * X.rotation, X.position + draw.vector3(reach)});
  }
  Target target;
  target.size = static_cast<std::uint8_t>(reference.size());
  for (std::size_t i = 0; i < target.size; ++i) target.values[i] = draw.uniform(-reach, reach);
  return target;
}

// Goals, one of which the hand cannot follow, a motion, a stream with a gap that breaks off; until `end`.
std::vector<double> run(Reference& reference, std::uint32_t seed, int end) {
  Draw draw(seed);
  start(reference, draw);
  const Quantity quantity = reference.spec().quantity;
  std::vector<double> all;
  for (int k = 1; k < end; ++k) {
    Target target = near(reference, draw, k < 2000 ? 0.2 : 0.002);
    const bool streams = k >= 2000 && k < 2400 && k % 20 == 0 && k != 2200;
    if (streams) target.delivery = Delivery::stream;
    if (k == 900) {
      target = {};
      target.delivery = Delivery::motion;
      target.size = static_cast<std::uint8_t>(motion_count(quantity, 7));
      target.period_s = 1;
      target.cycles = 0.6;
      for (std::size_t i = 0; i < target.size; ++i) target.values[i] = 0.02;
    }
    if (k == 50 || k == 300 || k == 420 || k == 900 || streams) {
      EXPECT_EQ(reference.post(target), Verdict::accepted);
    }
    if (k == 500) reference.set(target);
    if (quantity == Quantity::pose) reference.bound_hand_speed(0.3, 0.1);
    if (k >= 350 && k < 450) {
      if (quantity == Quantity::joints) reference.resist(reference.joint_velocity(), 0.95);
      if (quantity == Quantity::pose) reference.resist(reference.twist().vector, 0.95, 1.2);
    }
    reference.advance(0.001, 0.001 * k);
    if (k >= 350 && k < 450) reference.slow(0.96);
    double values[kMaxTargetValues]{}, rates[kMaxTargetValues]{};
    reference.record(values, rates);
    all.insert(all.end(), values, values + reference.size());
    all.insert(all.end(), rates, rates + reference.size());
    all.insert(all.end(),
               {reference.pace(), reference.stale() ? 1.0 : 0.0, reference.streaming() ? 1.0 : 0.0});
  }
  return all;
}

TEST(RestartedReference, GivesWhatANewOneGives) {
  for (const Quantity quantity : {Quantity::pose, Quantity::joints, Quantity::scalar, Quantity::wrench}) {
    Reference fresh = reference_of(quantity);
    const std::vector<double> expected = run(fresh, 2, 3000);
    for (const int end : {200, 400, 440, 1000, 1400, 2100, 2300, 2450, 2600}) {
      Reference used = reference_of(quantity);
      run(used, 1, end);
      ASSERT_EQ(used.post(near(used, *std::make_unique<Draw>(9), 0.1)), Verdict::accepted);  // discarded
      EXPECT_EQ(run(used, 2, 3000), expected) << to_string(quantity) << " after " << end;
    }
  }
}

}  // namespace
}  // namespace multipanda::restarted_reference_test
