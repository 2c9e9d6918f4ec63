#include <cstddef>
#include <multipanda_headers_hash.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/plugin/layout.hpp"
#include "core/plugin/load_plugin.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::own_controllet_test {
namespace {

using namespace test;
using testing::AllOf, testing::HasSubstr;

std::string library(const std::string& name) { return std::string(PLUGIN_FOLDER "/") + name + ".so"; }

std::string refusal(const std::string& path) {
  Registry registry = Registry::with_builtins();
  const std::size_t before = registry.controllets().size();
  try {
    load_plugin(registry, path);
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(registry.controllets().size(), before);
    return error.what();
  }
  return "accepted";
}

TEST(OwnControllet, IsLoadedAndNamed) {
  Registry registry = Registry::with_builtins();
  ASSERT_EQ(registry.controllet("virtual_wall"), nullptr);
  load_plugin(registry, library("own_controllet"));
  ASSERT_NE(registry.controllet("virtual_wall"), nullptr);
  EXPECT_THROW(load_plugin(registry, library("own_controllet")), std::invalid_argument);  // the name is taken
}

TEST(OwnControllet, PushesOutOfTheWallByStiffnessTimesDepth) {
  Registry registry;
  load_plugin(registry, library("own_controllet"));
  ControlletRig rig(*registry.controllet("virtual_wall"), {TestArm::make().model()});
  const double z = rig.terms(0).X_WE().position.z();
  rig.set("height_m", {z - 0.01});
  ASSERT_EQ(rig.start(), LawResult::ok);
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_EQ(rig.tau(0).norm(), 0);

  rig.set("height_m", {z + 0.004});
  ASSERT_EQ(rig.update(), LawResult::ok);
  const JointVector expected = rig.terms(0).J_V_WE().row(2).transpose() * 4.0;  // 1000 N/m * 4 mm, upwards
  EXPECT_NEAR((rig.tau(0) - expected).norm(), 0, 1e-9);
  EXPECT_NEAR(rig.output("depth_m")[0], 0.004, 1e-12);

  rig.set("height_m", {z + 0.1});
  EXPECT_EQ(rig.start(), LawResult::fault);  // would begin deep in the wall
}

TEST(OwnFeature, DampsJointsAboveItsSpeedOnly) {
  Registry registry;
  load_plugin(registry, library("own_controllet"));
  ControlletRig rig(*registry.feature("speed_damping"), {TestArm::make().model()});
  JointVector dq = JointVector::Zero(7);
  dq[1] = 0.5;
  dq[4] = -1.5;
  rig.set("speed_rad_per_s", {1.0});
  rig.set("damping_nms_per_rad", {4.0});
  rig.place(0, bent(7), dq);
  ASSERT_EQ(rig.start(), LawResult::ok);
  ASSERT_EQ(rig.update(), LawResult::ok);
  JointVector expected = JointVector::Zero(7);
  expected[4] = 2.0;  // 4 N m s/rad * 0.5 rad/s, against the motion
  EXPECT_NEAR((rig.tau(0) - expected).norm(), 0, 1e-12);
  EXPECT_NEAR(rig.output("largest_torque_nm")[0], 2.0, 1e-12);
}

// The same members: aligned differently they lie elsewhere, though the first two types have one size.
struct Sample {
  int a, b, c, d;
};
struct alignas(16) Aligned {
  int a, b, c, d;
};
struct Larger {
  int a, b, c, d, e;
};

TEST(OwnControllet, TheLayoutNumberKnowsSizesAndAlignments) {
  static_assert(sizeof(Sample) == sizeof(Aligned) && alignof(Sample) == alignof(Larger));
  static_assert(layout_of<Sample>() != layout_of<Aligned>());
  static_assert(layout_of<Sample>() != layout_of<Larger>());
  static_assert(layout_of<Sample, Larger>() != layout_of<Larger, Sample>());
  static_assert(fold({4, 16, 800}) != fold({4, 16, 808}));
  static_assert(fold({4, 16, 800, 808}) != fold({4, 16, 808, 800}));
  static_assert(fold({0, std::size_t{1} << 40}) != fold({0, 0}));  // all bytes count
  static_assert(kPluginLayout != kStateLayout);
}

TEST(OwnControllet, LibrariesThatDoNotFitAreRefusedWithTheReason) {
  EXPECT_NE(refusal(library("no_such_file")).find("no_such_file"), std::string::npos);
  EXPECT_NE(refusal(library("plugin_without_symbols")).find("MULTIPANDA_PLUGIN"), std::string::npos);
  EXPECT_THAT(refusal(library("plugin_of_older_version")),
              AllOf(HasSubstr("older version"), HasSubstr("rebuild it with the headers of this program")));
  EXPECT_THAT(refusal(library("plugin_of_other_headers")),
              AllOf(HasSubstr("other headers (hash fedcba9876543210)"),
                    HasSubstr("this program (hash " MULTIPANDA_HEADERS_HASH ")"), HasSubstr("rebuild")));
  // The right headers alone do not make it fit.
  EXPECT_THAT(refusal(library("plugin_of_other_layout")),
              AllOf(HasSubstr("another layout"), HasSubstr("-march=native")));
}

}  // namespace
}  // namespace multipanda::own_controllet_test
