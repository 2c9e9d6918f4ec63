// The performance measurement of a cycle in another program's loop. ros/host/performance_trace_test.py checks
// the numbers in its file.
#include "runtime/embedded/hosted_trace.hpp"

#include <algorithm>
#include <filesystem>
#include <mutex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "runtime/embedded/testing/signal_fixture.hpp"

namespace multipanda::hosted_trace_test {
namespace {

namespace fs = std::filesystem;
using test::eventually;
using test::Fixture;
using test::Gravity;
using test::kJoints;
using testing::ElementsAre;
using testing::HasSubstr;

// A folder of its own and the messages that a measurement leaves.
class Measured : public testing::Test {
 protected:
  Measured() {
    fs::remove_all(options.folder);
    options.condition = "NF";
    options.duration_s = 0.1;
    options.lead_s = 0.02;
  }
  ~Measured() override { fs::remove_all(options.folder); }
  std::unique_ptr<Fixture> begin() {
    auto fixture =
        std::make_unique<Fixture>(kJoints, true, std::vector<Gravity>{Gravity::cycle, Gravity::robot},
                                  options, [this](const std::string& text) {
                                    const std::lock_guard lock(mutex);
                                    messages.push_back(text);
                                  });
    fixture->cycle->activate();
    return fixture;
  }
  std::string last() {
    const std::lock_guard lock(mutex);
    return messages.back();
  }
  bool says(const std::string& text) {
    return eventually([&] { return last().find(text) != std::string::npos; });
  }
  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(options.folder))
      names.push_back(entry.path().filename().string());
    std::ranges::sort(names);
    return names;
  }

  HostedTraceOptions options{.folder = fs::temp_directory_path() /
                                       ("multipanda_hosted_trace_" + std::to_string(::getpid()))};
  std::mutex mutex;
  std::vector<std::string> messages;
};

TEST_F(Measured, AFullMeasurementIsWrittenOnceItsActivationEnds) {
  for (int number = 1; number <= 2; ++number) {  // no file is overwritten
    auto fixture = begin();
    fixture->steps(500);
    ASSERT_TRUE(fixture->relayed());
    EXPECT_EQ(files().size(), static_cast<std::size_t>(number - 1));  // nothing is written while it is active
    fixture->cycle->deactivate();
    EXPECT_TRUE(says("100 cycles are in " + (options.folder / "NF_").string() + std::to_string(number)));
    EXPECT_THAT(last(), HasSubstr("memory was full"));
    // A later activation is not measured.
    fixture->cycle->activate();
    fixture->steps(300);
    ASSERT_TRUE(fixture->relayed());
    fixture->cycle->deactivate();
  }
  EXPECT_THAT(files(), ElementsAre("NF_1.npz", "NF_2.npz"));
}

// A disk, or a listener, may be slow: the next activation has its topics all the same.
TEST_F(Measured, ANextActivationIsRelayedWhileTheFileIsWritten) {
  auto fixture = begin();
  fixture->steps(70);
  {
    const std::lock_guard slow(mutex);
    fixture->cycle->deactivate();
    fixture->cycle->activate();
    for (int k = 0; k < 3; ++k) {
      fixture->steps(50);
      EXPECT_TRUE(fixture->relayed()) << k;
    }
  }
  EXPECT_TRUE(says("50 cycles are in"));
}

TEST_F(Measured, AShortOneIsWrittenWithItsLastCycle) {
  auto fixture = begin();
  fixture->steps(70);
  fixture->cycle->deactivate();
  EXPECT_TRUE(says("50 cycles are in"));
  EXPECT_THAT(last(), testing::Not(HasSubstr("full")));
}

TEST_F(Measured, ACycleThatIsDestroyedWhileActiveLeavesItsFile) {
  auto fixture = begin();
  fixture->steps(45);
  fixture.reset();
  EXPECT_THAT(last(), HasSubstr("25 cycles are in"));
}

TEST_F(Measured, WhatNeverBeganLeavesNoFile) {
  auto fixture = begin();
  fixture->steps(20);
  fixture->cycle->deactivate();
  EXPECT_TRUE(says("ended within lead_s"));
  options.controllet = "left_joints";
  fixture = begin();
  fixture->steps(200);
  fixture->cycle->deactivate();
  EXPECT_TRUE(says("'left_joints' followed no stream"));
  EXPECT_TRUE(files().empty());
}

TEST_F(Measured, AFileThatCannotBeWrittenIsReported) {
  auto fixture = begin();
  fixture->steps(50);
  fs::remove_all(options.folder);
  fixture->cycle->deactivate();
  EXPECT_TRUE(says("the measurement is lost: cannot create"));
}

TEST_F(Measured, TheLoopNeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  auto fixture = begin();
  fixture->steps(20);
  LoopGuardCounts sum;
  for (int i = 0; i < 400; ++i) {  // before, during and after the cycles that are kept
    LoopGuard::arm();
    fixture->cycle->step(0.001);
    if (i == 350) fixture->cycle->deactivate();
    if (i == 351) fixture->cycle->activate();
    const LoopGuardCounts counts = LoopGuard::disarm();
    sum.heap_calls += counts.heap_calls;
    sum.lock_calls += counts.lock_calls;
  }
  EXPECT_EQ(sum.heap_calls, 0u);
  EXPECT_EQ(sum.lock_calls, 0u);
  EXPECT_TRUE(says("100 cycles are in"));
}

// Measuring changes no torque.
TEST_F(Measured, TorquesAreTheSameToTheBit) {
  Fixture plain;
  auto fixture = begin();
  plain.cycle->activate();
  for (int i = 0; i < 200; ++i) {
    fixture->step();
    plain.step();
    for (ArmIndex arm = 0; arm < 2; ++arm) ASSERT_EQ(fixture->command(arm), plain.command(arm)) << i;
  }
}

std::string refusal(const FlatParameters& parameters) {
  try {
    (void)hosted_trace_options(parameters);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "not refused";
}

TEST(HostedTraceOptions, AreReadFromParameters) {
  EXPECT_FALSE(hosted_trace_options({{"update_rate", std::int64_t{1000}}}).has_value());
  const FlatParameters folder{{"performance_trace.folder", std::string("/tmp/x")}};
  FlatParameters all = folder;
  all.emplace_back("performance_trace.condition", std::string("CA-MA"));
  EXPECT_EQ(hosted_trace_options(all)->duration_s, 30);
  all.emplace_back("performance_trace.duration_s", std::int64_t{5});
  all.emplace_back("performance_trace.lead_s", 0.5);
  all.emplace_back("performance_trace.controllet", std::string("dual"));
  const auto options = hosted_trace_options(all);
  ASSERT_TRUE(options.has_value());
  EXPECT_EQ(options->folder, "/tmp/x");
  EXPECT_EQ(options->condition, "CA-MA");
  EXPECT_EQ(options->controllet, "dual");
  EXPECT_EQ(options->duration_s, 5);
  EXPECT_EQ(options->lead_s, 0.5);

  EXPECT_THAT(refusal(folder), HasSubstr("performance_trace.condition': missing"));
  EXPECT_THAT(refusal({{"performance_trace.condition", std::string("NF")}}), HasSubstr("folder': missing"));
  EXPECT_THAT(refusal({{"performance_trace.folder", std::string("here")}}), HasSubstr("absolute path"));
  EXPECT_THAT(refusal({{"performance_trace.foldr", std::string("/tmp")}}),
              HasSubstr("did you mean 'folder'"));
  EXPECT_THAT(refusal({{"performance_trase.folder", std::string("/tmp")}}),
              HasSubstr("did you mean 'performance_trace.folder'"));
  EXPECT_THAT(refusal({{"performance_trace.condition", std::string("../NF")}}), HasSubstr("found '../NF'"));
  EXPECT_THAT(refusal({{"performance_trace.duration_s", 301.0}}), HasSubstr("from 0.001 to 300 s"));
  EXPECT_THAT(refusal({{"performance_trace.duration_s", 0.0}}), HasSubstr("from 0.001 to 300 s"));
  EXPECT_THAT(refusal({{"performance_trace.lead_s", std::string("1")}}), HasSubstr("expected a number"));
}

TEST_F(Measured, RefusalsAreMadeBeforeAnythingRuns) {
  options.controllet = "left_joint";
  try {
    (void)begin();
    FAIL() << "not refused";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("did you mean 'left_joints'"));
  }
  options.controllet.clear();
  options.folder = "/proc/multipanda";
  EXPECT_THROW((void)begin(), std::runtime_error);
}

}  // namespace
}  // namespace multipanda::hosted_trace_test
