#include "motion_generators/via_points/via_plan.hpp"

#include <fstream>
#include <stdexcept>
#include <unistd.h>

#include <gtest/gtest.h>

namespace multipanda::via_plan_test {
namespace {

// A run of one arm that stores the set-points that it receives.
class Memory final : public SetPointChannel {
 public:
  std::vector<Arm> arms(const std::vector<std::string>& names) override {
    requested = names;
    return std::vector<Arm>(names.size(), start);
  }
  Stream open(const std::string& controllet, const std::string& input, Quantity quantity) override {
    opened.push_back(controllet + "." + input + " " + std::string(to_string(quantity)));
    sent.emplace_back();
    return sent.size() - 1;
  }
  bool send(Stream stream, std::span<const double> values, std::int64_t) override {
    sent[stream].emplace_back(values.begin(), values.end());
    return !refuses;
  }
  void rest() override {}
  nlohmann::json channels() override { return {}; }

  Arm start;
  std::vector<std::string> requested, opened;
  std::vector<std::vector<std::vector<double>>> sent;
  bool refuses = false;
};

class ViaPlanFile : public testing::Test {
 protected:
  ~ViaPlanFile() override { std::filesystem::remove(path_); }
  const std::filesystem::path& file(const std::string& text) {
    std::ofstream(path_) << text;
    return path_;
  }
  std::filesystem::path path_ =
      std::filesystem::temp_directory_path() / ("via_plan_test_" + std::to_string(getpid()) + ".yaml");
};

constexpr const char* kFile = R"(
name: both
scale: 1
limits: {velocity_rad_per_s: 2, acceleration_rad_per_s2: 20, jerk_rad_per_s3: 500, speed_m_per_s: 0.3}
tracks:
  - arm: left
    joints_rad: [[0.1, -pi/2], [0.2, -1.5]]
    publish: [{controllet: joints, input: joints}]
  - arm: right
    poses: [{position_m: [0.05, 0, 0], rpy_rad: [pi/2, 0, 0]}]
    publish: [{controllet: pose, input: pose}, {controllet: other, input: pose, offset_m: [0, 0, 0.1]}]
)";

TEST_F(ViaPlanFile, PublishesEveryTrackToItsInputsUntilTheLastViaPoint) {
  const ViaPlan plan = load_via_plan(file(kFile));
  Memory link;
  link.start.q = JointVector::Zero(2);
  link.start.q[1] = -1.6;
  ViaRun run(plan, starts_in(link, plan));
  EXPECT_EQ(link.requested, (std::vector<std::string>{"left", "right"}));
  EXPECT_LT(run.duration(), 3);
  const PublishReport report = publish_via(run, link, {});
  EXPECT_EQ(link.opened,
            (std::vector<std::string>{"joints.joints joints", "pose.pose pose", "other.pose pose"}));
  EXPECT_EQ(report.ended_by, "goals");
  EXPECT_EQ(report.unsent, 0u);
  EXPECT_EQ(report.goals_reached, (std::vector<std::size_t>{2, 1}));
  ASSERT_EQ(link.sent[0].size(), report.samples);
  EXPECT_NEAR(link.sent[0].back()[0], 0.2, 1e-9);
  EXPECT_NEAR(link.sent[0].back()[1], -1.5, 1e-9);
  const auto &pose = link.sent[1].back(), &other = link.sent[2].back();
  ASSERT_EQ(pose.size(), 7u);
  EXPECT_NEAR(pose[0], 0.05, 1e-9);
  EXPECT_NEAR(std::abs(pose[3]), std::sqrt(0.5), 1e-9);  // half of pi/2
  EXPECT_NEAR(other[2] - pose[2], 0.1, 1e-12);
  // In small steps, except for missed periods: no speed above the file's.
  for (std::size_t k = 1; k < link.sent[0].size(); ++k)
    EXPECT_LE(std::abs(link.sent[0][k][0] - link.sent[0][k - 1][0]),
              2e-3 * static_cast<double>(report.missed + 1) + 1e-9);
}

TEST_F(ViaPlanFile, BrakesWhenStoppedAndGivesUpWhenNothingIsDelivered) {
  ViaPlan plan = load_via_plan(file(kFile));
  plan.repeat = true;
  Memory link;
  link.start.q = JointVector::Zero(2);
  std::atomic<bool> stop{true};
  ViaRun stopped(plan, starts_in(link, plan));
  for (int k = 0; k < 100; ++k) stopped.step(0.001);  // in full motion
  const PublishReport report = publish_via(stopped, link, {.stop = &stop});
  EXPECT_EQ(report.ended_by, "stopped");
  EXPECT_TRUE(stopped.at_rest());
  EXPECT_LT(stopped.time(), 1);
  EXPECT_EQ(stopped.passed(0), 0u);

  link.refuses = true;
  ViaRun alone(plan, starts_in(link, plan));
  EXPECT_EQ(publish_via(alone, link, {.patience_s = 0.5}).ended_by, "no_receiver");
}

TEST_F(ViaPlanFile, RepeatsWithoutAJump) {
  ViaPlan plan = load_via_plan(file(kFile));
  plan.repeat = true;
  Memory link;
  link.start.q = JointVector::Zero(2);
  ViaRun run(plan, starts_in(link, plan));
  std::vector<double> last = run.values(0);
  for (int k = 0; k < 10000; ++k) {
    run.step(0.001);
    const auto now = run.values(0);
    EXPECT_LE(std::abs(now[0] - last[0]), 2.001e-3);
    last = now;
  }
  EXPECT_FALSE(run.finished());
  EXPECT_GE(run.passed(0), 8u);
  EXPECT_EQ(run.passed(1), 1u);  // one via point: it stays there
}

TEST_F(ViaPlanFile, RefusalsNamePlaceAndCause) {
  const auto refusal = [this](const std::string& from, const std::string& to) {
    std::string text = kFile;
    text.replace(text.find(from), from.size(), to);
    try {
      (void)load_via_plan(file(text));
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("not refused");
  };
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  expect(refusal("scale: 1", "scale: 1.5"), "at most 1");
  expect(refusal("[0.2, -1.5]", "[0.2]"), "as many angles");
  expect(refusal("velocity_rad_per_s: 2", "velocity_rad_per_s: -2"), "expected");
  expect(refusal("joints_rad: [[0.1, -pi/2], [0.2, -1.5]]", "joints_rad: []"), "at least one via point");
  expect(refusal("    joints_rad: [[0.1, -pi/2], [0.2, -1.5]]\n", ""), "either 'joints_rad' or 'poses'");
  expect(refusal("arm: left", "arm: left\n    speed: 3"), "speed");
  ViaPlan plan = load_via_plan(file(kFile));
  Memory link;
  link.start.q = JointVector::Zero(7);
  try {
    const ViaRun run(plan, starts_in(link, plan));
    ADD_FAILURE() << "an arm with another number of joints was not refused";
  } catch (const std::invalid_argument& error) {
    expect(error.what(), "arm 'left'");
  }
}

}  // namespace
}  // namespace multipanda::via_plan_test
