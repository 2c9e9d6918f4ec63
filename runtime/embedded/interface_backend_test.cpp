// Arms of plain numbers whose joints are not all revolute.
#include "runtime/embedded/interface_backend.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::interface_backend_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// Seven joints; joint k, from 1, is prismatic (0: none).
std::shared_ptr<const ArmModel> arm(std::size_t k) {
  ArmModelSource source = test::TestArm::make(7).source({rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}});
  if (k > 0) {
    const std::string joint = "<joint name='joint" + std::to_string(k - 1) + "' type='";
    source.urdf.replace(source.urdf.find(joint) + joint.size(), 8, "prismatic");
  }
  return std::make_shared<const ArmModel>(std::move(source));
}

InterfaceBackend backend_of(const std::shared_ptr<const ArmModel>& model) {
  InterfaceBackend::Arm one{.host = {.name = "arm", .joints = {}, .gravity = HostedArm::Gravity::robot},
                            .model = model,
                            .config = {},
                            .safety = SafetyLimits::of(*model)};
  return InterfaceBackend({std::move(one)}, 0.001);
}

// A force would act where a torque was computed.
TEST(InterfaceBackend, RefusesAnArmWhoseJointsAreOfAnotherKind) {
  for (const std::size_t ours : {0, 3, 4}) {
    for (const std::size_t theirs : {0, 3, 4}) {
      InterfaceBackend backend = backend_of(arm(ours));
      ModelTerms terms(arm(theirs));
      SharedArmState shared;
      shared.model = &terms;
      shared.state.q = joint_constant(7, 0);
      backend.signals(0).shared = &shared;
      const std::string why = backend.check();
      if (ours == theirs) {
        EXPECT_EQ(why, "");
        continue;
      }
      const bool first_is_theirs = theirs > 0 && (ours == 0 || theirs < ours);
      const std::string joint = "'arm_joint" + std::to_string(first_is_theirs ? theirs : ours) + "' is ";
      EXPECT_THAT(why, AllOf(HasSubstr(joint + (first_is_theirs ? "prismatic" : "revolute") +
                                       " in the hardware's arm"),
                             HasSubstr("same model")));
      shared.model = nullptr;  // it does not say what its joints are
      EXPECT_EQ(backend.check(), "");
    }
  }
}

// Numbers that stay the same cannot be those of an arm that moves: 0.05 rad/s, but 0.01 m/s.
TEST(InterfaceBackend, KnowsFrozenNumbersOfACarriage) {
  for (const std::size_t prismatic : {0, 3}) {
    for (const double speed : {0.005, 0.02, 0.1}) {
      const auto model = arm(prismatic);
      InterfaceBackend backend = backend_of(model);
      backend.signals(0).velocity[2] = -speed;
      EXPECT_EQ(backend.check(), "");
      backend.begin();
      const int silent = static_cast<int>(1000 * SafetyLimits::of(*model).max_silence_s) + 3;
      bool due = true;
      for (int k = 0; k < silent; ++k) due = !backend.advance(0.001).empty();
      EXPECT_EQ(due, speed < (prismatic > 0 ? 0.01 : 0.05)) << prismatic << " " << speed;
    }
  }
}

}  // namespace
}  // namespace multipanda::interface_backend_test
