#include "core/cycle/requests.hpp"

#include <chrono>
#include <cmath>
#include <functional>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "core/cycle/backend.hpp"
#include "core/state/arm_state.hpp"

// Texts of requests to arms, and of their answers.
namespace multipanda::requests_test {
namespace {

TEST(GripperRequests, AreRefusedForTheirFirstFault) {
  const double nan = std::nan("");
  EXPECT_EQ(check(GripperMove{0, 0.1}), "");
  EXPECT_EQ(check(GripperGrasp{0.04, 0.1, 40, 0, 0}), "");
  EXPECT_EQ(check(GripperGrasp{0, 1e-9, 1e-9, 0, 0}), "");
  for (const double width : {-0.01, nan, 1.1, 1e300, double{INFINITY}})
    EXPECT_EQ(check(GripperMove{width, -1}), "the width must be 0 to 1 m");
  for (const double speed : {0.0, nan, 10.1}) {
    EXPECT_EQ(check(GripperMove{0.02, speed}), "the speed must be above 0 and at most 10 m/s");
    EXPECT_EQ(check(GripperGrasp{0.02, speed, 0}), "the speed must be above 0 and at most 10 m/s");
  }
  for (const double force : {0.0, double{INFINITY}, 1000.1})
    EXPECT_EQ(check(GripperGrasp{0.02, 0.1, force}), "the force must be above 0 and at most 1000 N");
  for (const double tolerance : {-0.001, nan, 1.1}) {
    EXPECT_EQ(check(GripperGrasp{0.02, 0.1, 40, tolerance, 0}), "the tolerances must be 0 to 1 m");
    EXPECT_EQ(check(GripperGrasp{0.02, 0.1, 40, 0, tolerance}), "the tolerances must be 0 to 1 m");
  }
}

TEST(GripperRequests, OfAVacuumHaveBounds) {
  EXPECT_EQ(check(VacuumOn{}), "");
  EXPECT_EQ(check(VacuumDrop{}), "");
  EXPECT_EQ(check(VacuumStop{}), "");
  for (const double mbar : {50.0, 1000.0}) EXPECT_EQ(check(VacuumOn{.pressure_mbar = mbar}), "");
  for (const double mbar : {-3.0, 1.0, 49.0, 1001.0, 1e300, std::nan("")})
    EXPECT_EQ(check(VacuumOn{.pressure_mbar = mbar}), "the vacuum must be 50 to 1000 mbar");
  for (const double timeout : {0.0, 61.0, 1e300, std::nan("")}) {
    EXPECT_EQ(check(VacuumOn{.timeout_s = timeout}), "the timeout must be above 0 and at most 60 s");
    EXPECT_EQ(check(VacuumDrop{timeout}), "the timeout must be above 0 and at most 60 s");
  }
}

TEST(GripperRequests, OfAFollowedWidthHaveTheBoundsOfAGraspAndASilence) {
  EXPECT_EQ(check(GripperFollow{}), "") << "stays where it is";
  for (const double silence : {1e-9, 0.2, 1.0}) EXPECT_EQ(check(GripperFollow{.silence = silence}), "");
  for (const double silence : {0.0, -0.1, 1.001, std::nan("")})
    EXPECT_EQ(check(GripperFollow{.silence = silence}), "the silence must be above 0 and at most 1 s");
  EXPECT_EQ(check(GripperFollow{.width = 1.1}), "the width must be 0 to 1 m");
  EXPECT_EQ(check(GripperFollow{.speed = 0}), "the speed must be above 0 and at most 10 m/s");
  EXPECT_EQ(check(GripperFollow{.force = 0}), "the force must be above 0 and at most 1000 N");
}

TEST(RequestTimes, TheLatestStartIsInTime) {
  const HostTime now = host_now();
  EXPECT_FALSE(is_past(nullptr, now));
  for (const int late : {-1, 0, 1})
    EXPECT_EQ(is_past(std::make_shared<const std::atomic<std::int64_t>>(now.ns - late), now), late > 0);
}

// What a request declares, as programs see it. "key" is required, "key?" optional; "+" is positive, "0" zero
// or more.
struct Declared {
  std::vector<std::string> keys;
  std::function<double(const std::string&)> number;  // of the optional fields that are given; NaN: absent

  void required(const std::string& key, auto& /*value*/, RequestBound bound = RequestBound::any) {
    keys.push_back(key + mark(bound));
  }
  void optional(const std::string& key, auto& value, RequestBound bound = RequestBound::any) {
    keys.push_back(key + "?" + mark(bound));
    if constexpr (std::is_same_v<decltype(value), double&>) {
      if (number && !std::isnan(number(key))) value = number(key);
    }
  }
  void pose(Pose& /*value*/) { keys.emplace_back("a pose"); }
  void expect(bool condition, const char* /*text*/) { keys.emplace_back(condition ? "good" : "refused"); }
  static std::string mark(RequestBound bound) {
    return bound == RequestBound::positive ? "+" : bound == RequestBound::not_negative ? "0" : "";
  }
};

template <typename Asked>
std::vector<std::string> declared(Asked request = {}) {
  Declared fields;
  request.visit(fields);
  return fields.keys;
}

// These words are a contract: programs of others use them (docs/live_input.md).
TEST(RequestFields, AreThoseThatProgramsUse) {
  using Keys = std::vector<std::string>;
  EXPECT_EQ(declared<SetLoad>(), (Keys{"mass_kg0", "com_m?", "inertia_kg_m2?"}));
  EXPECT_EQ(declared<SetFrames>(), (Keys{"end_effector?", "stiffness_frame?", "refused"}));
  EXPECT_EQ(declared<SetFrames>({.X_FE = Pose{}}).back(), "good");
  EXPECT_EQ(declared<SetFrames>({.X_EK = Pose{}}).back(), "good");
  EXPECT_EQ(declared<SetJointStiffness>(), Keys{"joint_stiffness_nm_per_rad"});
  EXPECT_EQ(declared<SetCartesianStiffness>(), Keys{"cartesian_stiffness"});
  EXPECT_EQ(declared<ContactThresholds>(),
            (Keys{"torque_lower_nm", "torque_upper_nm", "wrench_lower", "wrench_upper"}));
  EXPECT_EQ(declared<SetCollisionThresholds>(), (Keys{"nominal", "acceleration?"}));
  EXPECT_EQ(declared<SetGuidingMode>(), (Keys{"axes", "elbow?"}));
  EXPECT_EQ(declared<RecoverFromError>(), Keys{});
  EXPECT_EQ(declared<SetUserStop>(), Keys{"pressed"});
  EXPECT_EQ(declared<GripperMove>(), (Keys{"width_m0", "speed_m_per_s?+"}));
  EXPECT_EQ(declared<GripperGrasp>(), (Keys{"width_m0", "speed_m_per_s?+", "force_n?+", "tolerance_m?0",
                                            "tolerance_inner_m?0", "tolerance_outer_m?0"}));
  EXPECT_EQ(declared<GripperFollow>(), (Keys{"width_m?0", "speed_m_per_s?+", "force_n?+", "silence_s?+"}));
  EXPECT_EQ(declared<VacuumOn>(), (Keys{"vacuum_mbar?+", "timeout_s?+"}));
  EXPECT_EQ(declared<VacuumDrop>(), Keys{"timeout_s?+"});
  EXPECT_EQ(declared<PlaceObject>(), (Keys{"object", "a pose"}));
  EXPECT_EQ(declared<PushObject>(), (Keys{"object", "force_n", "duration_s?+"}));
  EXPECT_EQ(declared<PauseSimulation>(), Keys{"paused?"});
  EXPECT_EQ(declared<StepSimulation>(), Keys{"periods?"});
}

TEST(RequestFields, OneToleranceIsForBothSidesUnlessOneIsNamed) {
  const auto grasp = [](double both, double inner, double outer) {
    GripperGrasp request;
    Declared fields;
    fields.number = [&](const std::string& key) {
      return key == "tolerance_m"         ? both
             : key == "tolerance_inner_m" ? inner
             : key == "tolerance_outer_m" ? outer
                                          : std::nan("");
    };
    request.visit(fields);
    return std::pair(request.tolerance_inner, request.tolerance_outer);
  };
  const double none = std::nan("");
  EXPECT_EQ(grasp(none, none, none), std::pair(0.005, 0.005));
  EXPECT_EQ(grasp(0.02, none, none), std::pair(0.02, 0.02));
  EXPECT_EQ(grasp(0.02, 0.01, none), std::pair(0.01, 0.02));
  EXPECT_EQ(grasp(none, none, 0.03), std::pair(0.005, 0.03));
}

TEST(Answers, AreThereAtOnceAndSayWhy) {
  const auto reason = [](std::future<RequestAnswer> answer) {
    if (answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return std::string("waits");
    const RequestAnswer given = answer.get();
    return given.success ? "success" : given.reason;
  };
  EXPECT_EQ(reason(answer_now({.success = true})), "success");
  EXPECT_EQ(reason(refuse_request("not here")), "not here");
  struct Plain final : Backend {
    std::size_t arm_count() const override { return 1; }
    Capabilities capabilities(ArmIndex) const override { return {}; }
    ArmSet wait() override { return {}; }
    LoopTime now() const override { return {}; }
    void read(ArmSet, std::span<ArmState>) override {}
    void write(ArmSet, std::span<const ArmCommand>) override {}
    using Backend::request;
    std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }
  } plain;
  EXPECT_EQ(reason(plain.request(0, GripperRequest(GripperStop{}))), "this backend has no grippers");
  EXPECT_NE(reason(plain.request(WorldRequest(ResetSimulation{}))).find("needs simulated arms"),
            std::string::npos);
  EXPECT_EQ(no_such_arm(3, 2), "there is no arm 3: the run has 2");
}

TEST(ArmWords, EveryModeHasItsOwnName) {
  std::set<std::string_view> words;
  for (int mode = 0; mode <= static_cast<int>(ArmMode::disconnected); ++mode) {
    words.insert(to_string(static_cast<ArmMode>(mode)));
  }
  EXPECT_EQ(words.size(), 8u);
  EXPECT_FALSE(words.contains("unknown"));
  EXPECT_EQ(to_string(ArmMode::user_stopped), "user_stopped");
  EXPECT_EQ(to_string(static_cast<ArmMode>(8)), "unknown");
}

}  // namespace
}  // namespace multipanda::requests_test
