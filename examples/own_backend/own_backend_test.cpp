#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/plugin/load_plugin.hpp"
#include "examples/own_backend/free_arms.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::own_backend_test {
namespace {

using testing::HasSubstr;

std::string library(const std::string& name) { return std::string(PLUGIN_FOLDER "/") + name + ".so"; }

Scene example(const Registry& registry) {
  std::ifstream file(SCENE);
  std::stringstream text;
  text << file.rdbuf();
  std::string scene = text.str();
  const std::string path = "../../build/examples/own_backend/own_backend.so";
  scene.replace(scene.find(path), path.size(), library("own_backend"));
  return parse_scene(scene, SCENE, registry);
}

std::string refusal(const Registry& registry, const BackendOptions& options) {
  try {
    (void)make_backend(example(registry), registry, options,
                       {.paced = false, .report = [](const std::string&) {}});
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(OwnBackend, RunsTheSceneThatNamesIt) {
  Registry registry = Registry::with_builtins();
  load_plugin(registry, library("own_backend"));
  Session session(example(registry), registry, {.paced = false, .duration_s = 0.5});
  EXPECT_EQ(session.backend_description(), "free_arms");
  session.start();
  EXPECT_TRUE(session.wait_for_end(60));
  const RunSummary summary = session.finish();
  EXPECT_TRUE(summary.success());
  EXPECT_NEAR(summary.time_s, 0.5, 2e-3);
}

TEST(OwnBackend, IsRefusedWithoutItsLibrary) {
  Registry with = Registry::with_builtins();
  load_plugin(with, library("own_backend"));
  EXPECT_THAT(refusal(with, backend_named("free_arm")), HasSubstr("'free_arms'"));
  EXPECT_THAT(refusal(Registry::with_builtins(), {}), HasSubstr("there is no backend 'free_arms'"));
}

// Registered here, as a library would.
class Altered final : public FreeArms {
 public:
  Altered(const BackendSetup& setup, double period, bool compensates_gravity)
      : FreeArms(setup), period_(period), compensates_gravity_(compensates_gravity) {
    setup.report("made");
  }
  double period() const override { return period_; }
  Capabilities capabilities(ArmIndex) const override { return {.compensates_gravity = compensates_gravity_}; }

 private:
  double period_;
  bool compensates_gravity_;
};

Registry with_altered(double period, bool compensates_gravity) {
  Registry registry = Registry::with_builtins();
  load_plugin(registry, library("own_backend"));
  registry.add(BackendType{.name = "altered", .doc = "", .create = [=](const BackendSetup& setup) {
                             return std::make_unique<Altered>(setup, period, compensates_gravity);
                           }});
  return registry;
}

TEST(OwnBackend, IsRefusedWithAnImpossiblePeriodOrWithoutGravity) {
  for (const double period : {0.0, -0.001, 0.1, std::nan("")}) {
    EXPECT_THAT(refusal(with_altered(period, true), backend_named("altered")), HasSubstr("period"));
  }
  EXPECT_THAT(refusal(with_altered(0.001, false), backend_named("altered")),
              HasSubstr("gravity of arm 'left'"));
  EXPECT_EQ(refusal(with_altered(0.001, true), backend_named("altered")), "accepted");
}

TEST(OwnBackend, IsRefusedSettingsThatItCannotMake) {
  Registry registry = Registry::with_builtins();
  load_plugin(registry, library("own_backend"));
  Scene scene = example(registry);
  scene.arms[1].cartesian_stiffness = Vector6::Constant(100);
  try {
    (void)make_backend(scene, registry, {}, {.paced = false, .report = {}});
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("arm 'right'"));
  }
}

TEST(OwnBackend, MayReportWhileItIsMade) {
  const Registry registry = with_altered(0.001, true);
  Session session(example(registry), registry,
                  {.paced = false, .backend = backend_named("altered"), .duration_s = 0.05});
  session.start();
  EXPECT_TRUE(session.wait_for_end(60));
  EXPECT_TRUE(session.finish().success());
}

TEST(OwnBackend, LibraryBuiltWithOtherHeadersIsRefused) {
  Registry registry = Registry::with_builtins();
  try {
    load_plugin(registry, library("backend_of_other_headers"));
    FAIL() << "accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("hash fedcba9876543210"));
    EXPECT_THAT(error.what(), HasSubstr("rebuild"));
  }
  EXPECT_TRUE(registry.backends().empty());
}

}  // namespace
}  // namespace multipanda::own_backend_test
