// The first cycle waits for a state of every arm. Fake arms send a state when the last one was answered, so
// that nothing depends on how fast the test runs.
#include <array>
#include <memory>
#include <thread>

#include <gtest/gtest.h>

#include "fci/client/fci_backend.hpp"
#include "fci/client/state_intake.hpp"
#include "fci/client/testing/fake_arm.hpp"
#include "scene/build.hpp"

namespace multipanda::fci::first_states_test {
namespace {

TEST(FirstStates, AnArmIsHeldOncePerStateFromItsSecondOn) {
  FirstStates states;
  EXPECT_FALSE(states.is_to_be_held(0, 7));  // the loop itself may answer it in time
  EXPECT_FALSE(states.is_to_be_held(0, 7));
  EXPECT_TRUE(states.is_to_be_held(0, 8));
  EXPECT_FALSE(states.is_to_be_held(0, 8));
  EXPECT_FALSE(states.is_to_be_held(1, 8));  // each arm counts its own
  EXPECT_TRUE(states.is_to_be_held(0, 30));
  EXPECT_TRUE(states.is_to_be_held(0, 3));  // of a counter that began again
  EXPECT_TRUE(states.is_to_be_held(1, 9));
}

class FirstCycle : public testing::Test {
 protected:
  FirstCycle() {
    for (std::size_t i = 0; i < 2; ++i) {
      fakes_[i]->set_automatic(false);  // a state per request, otherwise when the test sends one
      SceneArm arm;
      arm.name = i == 0 ? "left" : "right";
      arm.model = "fr3";
      arm.hand = false;
      configs_.push_back(fci_arm_config(arm, fakes_[i]->address()));
      configs_.back().port = fakes_[i]->port();
      configs_.back().end_effector = {};
      const JointVector q = configs_.back().model->q_home();
      fakes_[i]->change([&](RobotState& s) { std::copy(q.begin(), q.end(), s.q.begin()); });
    }
  }
  // In torque control; what the arms sent so far has been read.
  void begin(double first_states_s) {
    FciOptions options;
    options.model_check = ModelCheck::off;
    options.first_states_s = first_states_s;
    options.state_timeout_s = options.lost_after_s = 20;  // the whole machine may stand still for seconds
    backend_ = std::make_unique<FciBackend>(configs_, options);
    backend_->start();
    for (auto& fake : fakes_) (void)fake->commands_waiting();
  }
  // The left arm, which moves, until the loop waits for the other one alone: one of its states is answered.
  void send_left_until_answered() {
    fakes_[0]->change([](RobotState& s) { s.dq.fill(0.2); });
    const auto received_within = [&](std::uint64_t count, double patience_s) {
      const HostTime since = host_now();
      while (backend_->connection(0)->received < count && seconds(host_now() - since) < patience_s)
        std::this_thread::yield();
    };
    const HostTime begun = host_now();
    while (seconds(host_now() - begun) < 40) {
      const std::uint64_t count = backend_->connection(0)->received;
      const std::uint64_t number = fakes_[0]->publish();
      received_within(count + 1, 20);
      // The loop may be about to answer this state, or may not wait yet.
      while (const auto answer = fakes_[0]->command(0.005)) {
        if (answer->message_id == number) return;
      }
    }
    ADD_FAILURE() << "no state has an answer";
  }
  // The next state of the left arm, and the answer to it.
  RobotCommand answer_left() {
    const std::uint64_t number = fakes_[0]->publish();
    const auto answer = fakes_[0]->command();
    EXPECT_TRUE(answer) << number << " has no answer";
    if (!answer) return {};
    EXPECT_EQ(answer->message_id, number);
    EXPECT_EQ(fakes_[0]->commands_waiting(), 0u) << "and only one";
    fakes_[0]->change([&](RobotState& s) { s.tau_J_d = answer->tau_J_d; });
    return *answer;
  }

  std::array<std::unique_ptr<FakeArm>, 2> fakes_{std::make_unique<FakeArm>(10, "127.0.0.1"),
                                                 std::make_unique<FakeArm>(10, "127.0.0.2")};
  std::vector<FciArmConfig> configs_;
  std::unique_ptr<FciBackend> backend_;
};

TEST_F(FirstCycle, ArmsThatHaveAStateAreHeldUntilTheLastOneHasOne) {
  constexpr int kStates = 60;  // an arm that got no answer would have stopped itself after 20
  begin(60);
  std::vector<RobotCommand> answers;
  std::size_t to_right = 99;
  std::thread arms([&] {
    send_left_until_answered();
    for (int k = 0; k < kStates; ++k) answers.push_back(answer_left());
    to_right = fakes_[1]->commands_waiting();
    fakes_[1]->publish();
  });
  const ArmSet due = backend_->wait();
  arms.join();
  EXPECT_EQ(due, ArmSet::all(2));
  EXPECT_EQ(to_right, 0u);
  ASSERT_EQ(answers.size(), static_cast<std::size_t>(kStates));
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_LT(answers.back().tau_J_d[j], j < 4 ? -0.1 : 0.0) << "braked in joint " << j;
    for (std::size_t k = 1; k < answers.size(); ++k) {
      EXPECT_LE(std::abs(answers[k].tau_J_d[j] - answers[k - 1].tau_J_d[j]), 1) << k;
    }
  }
  // The first cycle reads the newest states and answers them.
  std::vector<ArmState> states(2);
  backend_->read(due, states);
  for (const auto& state : states) EXPECT_EQ(state.mode, ArmMode::move);
  EXPECT_EQ(states[0].sequence, answers.back().message_id);
}

TEST_F(FirstCycle, AnArmWithoutAStateIsWaitedForNoLongerThanToldAndOnlyOnce) {
  begin(0.05);
  fakes_[0]->publish();
  EXPECT_EQ(backend_->wait(), ArmSet::of(0));
  EXPECT_EQ(fakes_[0]->commands_waiting(), 0u);
  for (int k = 0; k < 10; ++k) {
    fakes_[0]->publish();
    EXPECT_EQ(backend_->wait(), ArmSet::of(0)) << k;
    EXPECT_EQ(fakes_[0]->commands_waiting(), 0u) << "the loop answers it, with write()";
  }
}

}  // namespace
}  // namespace multipanda::fci::first_states_test
