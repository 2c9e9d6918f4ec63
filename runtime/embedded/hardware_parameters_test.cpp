#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "runtime/embedded/hardware_system.hpp"

namespace multipanda::hardware_parameters_test {
namespace {

using testing::HasSubstr;

TEST(HardwareParameters, DescribeASceneAlsoInTheReferenceSystemsTerms) {
  const Scene own = hardware_scene({{"arm_names", "left, right"},
                                    {"arms.left.base.position_m", "[0, 0.26, 0]"},
                                    {"arms.right.hand", "false"},
                                    {"objects.box.shape", "box"},
                                    {"objects.box.size_m", "[0.1, 0.1, 0.1]"},
                                    {"objects.box.fixed", "false"},
                                    {"objects.box.mass_kg", "0.5"},
                                    {"node_name", "x"}},
                                   false, {"node_name"});
  ASSERT_EQ(own.arms.size(), 2u);
  EXPECT_EQ(own.arms[0].X_WB.position, Vector3(0, 0.26, 0));
  EXPECT_FALSE(own.arms[1].hand);
  EXPECT_FALSE(own.objects.at(0).fixed);
  const Scene known = hardware_scene({{"robot_count", "2"},
                                      {"ns_1", "mj_left"},
                                      {"ns_2", "mj_right"},
                                      {"hand_1", "True"},
                                      {"hand_2", "False"},
                                      {"robot_ip_1", "172.16.0.2"},
                                      {"robot_ip_2", "172.16.1.2"},
                                      {"arms.mj_right.base.position_m", "[0, -0.26, 0]"}},
                                     true);
  EXPECT_EQ(known.arms.at(1).name, "mj_right");
  EXPECT_FALSE(known.arms[1].hand);
  EXPECT_EQ(known.arms[1].fci->address, "172.16.1.2");
  const Scene named = hardware_scene({{"scene", "two_arms"}}, false);
  EXPECT_EQ(named.arms.size(), 2u);
  EXPECT_TRUE(named.controllets.empty());
  const auto refusal = [](std::map<std::string, std::string> parameters, bool real) -> std::string {
    try {
      (void)hardware_scene(parameters, real);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_THAT(refusal({{"arm_names", "left"}}, true), HasSubstr("'left' has no address"));
  EXPECT_THAT(refusal({{"arm_names", "left"}, {"arms.left.fci", "1.2.3.4"}}, false), HasSubstr("FciSystem"));
  EXPECT_THAT(refusal({{"arm_name", "left"}}, false), HasSubstr("did you mean 'arm_names'"));
  EXPECT_THAT(refusal({{"scene", "two_arms"}, {"arm_names", "left"}}, false),
              HasSubstr("define it in that scene"));
  EXPECT_THAT(refusal({{"robot_count", "2"}, {"ns_1", "left"}}, false), HasSubstr("ns_2"));
  EXPECT_THAT(refusal({{"robot_count", "two"}}, false), HasSubstr("whole number"));
}

}  // namespace
}  // namespace multipanda::hardware_parameters_test
