// What a law believes of an arm's estimate: its bias at rest, contacts at the start, errors of motion.
#include "core/controllets/felt_wrench.hpp"

#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/state/external_force.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::felt_wrench_test {
namespace {

using namespace test;
using Tare = FeltWrench::Tare;

// The bias of a real Panda at rest, less, since this arm is smaller.
const JointVector kBias = 0.4 * (JointVector(7) << -0.51, -0.38, -0.31, 0.57, 0.08, 0.12, -0.32).finished();
const Pose kTool{rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.02, -0.01, 0.1)};
const Pose kStiffness{rotation_from_rpy({0.1, 0.4, -0.3}), Vector3(0.01, 0.03, -0.04)};
const Pose kBase{rotation_from_rpy({0.4, -0.7, 1.1}), Vector3(0.3, -0.8, 0.5)};

// An arm whose joint torques are known, and what its own estimate makes of them: the wrench at K whose joint
// torques are nearest, by another inverse than the product's.
struct Bench {
  Bench() : rig(force_controllet(), {TestArm::make(7).model(kBase)}) {
    rig.frames(0, {kTool, kStiffness});
    rig.state(0).has_wrench_estimate = true;
    at(bent(7));
  }
  void at(const JointVector& q, const JointVector& dq = joint_constant(7, 0)) { rig.place(0, q, dq); }
  void feel(const JointVector& tau) {
    const Jacobian J = rig.terms(0).J_V_WK();
    const Eigen::MatrixXd JJt = J * J.transpose();
    rig.state(0).tau_ext_hat = tau;
    rig.state(0).F_K_W_est.vector = inverse(JJt) * Eigen::VectorXd(J * tau);
  }
  // The torques of a wrench that the arm exerts at E.
  JointVector of(const Vector6& F_E) { return rig.terms(0).J_V_WE().transpose() * F_E; }
  OwnedArm owned() { return {.state = &rig.state(0), .terms = &rig.terms(0)}; }
  void run(FeltWrench& felt, int ticks) {
    for (int i = 0; i < ticks; ++i) felt.update(owned(), false, 0.001);
  }
  FeltWrench tared() {
    FeltWrench felt;
    felt.start(owned());
    run(felt, 201);
    return felt;
  }

  ControlletRig rig;
};

Vector6 six(const Vector3& force, const Vector3& moment) {
  Vector6 F;
  F << force, moment;
  return F;
}

TEST(FeltWrench, TheBiasOfARealPandaIsGoneInEveryPose) {
  Bench bench;
  bench.feel(kBias);
  FeltWrench felt;
  felt.start(bench.owned());
  bench.run(felt, 199);
  EXPECT_TRUE(felt.waits());
  EXPECT_EQ(felt.at_E(), (Vector6::Zero()));  // nothing is felt until then
  bench.run(felt, 2);
  ASSERT_EQ(felt.tare(), Tare::taken);
  Draw draw(3);
  for (int i = 0; i < 5; ++i) {
    bench.at(bent(7) + draw.joints(7, 0.1));
    const Vector6 F = six(draw.vector3(20), draw.vector3(3));
    bench.feel(kBias + bench.of(F));
    bench.run(felt, 1);
    EXPECT_LT((felt.at_E() - F).norm(), 5e-3) << i;  // kEps of wrench_of()
  }
}

TEST(FeltWrench, AContactAtTheStartStaysFelt) {
  for (const double force : {6.0, 20.0}) {
    Bench bench;
    const Vector6 F = six({0, 0, -force}, Vector3::Zero());
    bench.feel(bench.of(F));
    const FeltWrench felt = bench.tared();
    EXPECT_EQ(felt.tare(), Tare::too_large);
    EXPECT_LT((felt.at_E() - F).norm(), 0.01);
  }
  // A moment, too, that a bias at rest does not make.
  Bench turned;
  Draw draw(9);
  JointVector tau;
  do tau = turned.of(six(Vector3::Zero(), 1.1 * draw.vector3(1).normalized()));
  while (tau.cwiseAbs().maxCoeff() > 0.75);
  turned.feel(tau);
  EXPECT_EQ(turned.tared().tare(), Tare::too_large);
  // One of less than a bias may be is not told from one, and costs no more than itself.
  Bench bench;
  const JointVector light = bench.of(six({0, 0, -1}, Vector3::Zero()));
  bench.feel(light);
  FeltWrench felt = bench.tared();
  ASSERT_EQ(felt.tare(), Tare::taken);
  bench.feel(10 * light);
  bench.run(felt, 1);
  EXPECT_NEAR(felt.at_E().z(), -9, 0.01);
}

// Near singular poses arms send a wrench of exactly 0, and a bias of joint torques becomes a large one: what
// comes off is bounded, and nothing comes off what is not felt.
TEST(FeltWrench, ABiasIsNoPhantomInSingularPoses) {
  Bench bench;
  bench.feel(kBias);
  FeltWrench felt = bench.tared();
  ASSERT_EQ(felt.tare(), Tare::taken);
  double largest = 0;
  Draw draw(8);
  for (int i = 0; i < 300; ++i) {
    bench.at(bent(7) + draw.joints(7, 3));
    const Jacobian J = bench.rig.terms(0).J_V_WE();
    largest = std::max(largest, wrench_of(J, kBias).force().norm());
    bench.rig.state(0).tau_ext_hat = kBias;
    bench.rig.state(0).F_K_W_est.vector.setZero();
    bench.run(felt, 1);
    EXPECT_EQ(felt.at_E(), (Vector6::Zero()));
    bench.rig.state(0).F_K_W_est.vector = six({1e-3, 0, 0}, Vector3::Zero());
    bench.run(felt, 1);
    EXPECT_LT(felt.at_E().head<3>().norm(), FeltWrench::kMostForce + 0.01);
  }
  EXPECT_GT(largest, 2 * FeltWrench::kMostForce);
}

TEST(FeltWrench, TakesNothingFromAnArmThatMovesOrTellsNothing) {
  const auto tare = [](const std::function<void(Bench&, int)>& each) {
    Bench bench;
    bench.feel(kBias);
    FeltWrench felt;
    felt.start(bench.owned());
    for (int i = 0; i < 210; ++i) {
      each(bench, i);
      felt.update(bench.owned(), false, 0.001);
    }
    return felt.tare();
  };
  EXPECT_EQ(tare([](Bench&, int) {}), Tare::taken);
  for (const int when : {20, 190}) {
    for (const double speed : {0.03, std::numeric_limits<double>::quiet_NaN()}) {
      EXPECT_EQ(tare([&](Bench& bench, int i) {
                  bench.rig.state(0).dq = joint_constant(7, 0);
                  if (i == when) bench.rig.state(0).dq[5] = speed;
                }),
                Tare::moved);
    }
  }
  EXPECT_EQ(tare([&](Bench& bench, int i) {
              bench.rig.state(0).tau_ext_hat = kBias;
              if (i == 150) bench.rig.state(0).tau_ext_hat[2] = std::numeric_limits<double>::quiet_NaN();
            }),
            Tare::too_large);
  Bench mute;  // an estimate without joint torques
  mute.rig.state(0).tau_ext_hat.resize(0);
  FeltWrench felt;
  felt.start(mute.owned());
  EXPECT_FALSE(felt.waits());
}

// What it may be wrong by is doubt until a rest without contact, at once at the start or later.
TEST(FeltWrench, TakesItsTareAtTheFirstRestWithoutContact) {
  for (const bool moves : {true, false}) {
    Bench bench;
    const JointVector touch = bench.of(six({0, 0, -20}, Vector3::Zero()));
    bench.at(bent(7), joint_constant(7, moves ? 0.1 : 0));
    bench.feel(kBias + (moves ? joint_constant(7, 0) : touch));
    FeltWrench felt = bench.tared();
    EXPECT_EQ(felt.tare(), moves ? Tare::moved : Tare::too_large);
    EXPECT_EQ(felt.doubt(0.5), 0.5 * FeltWrench::kMostForce);
    EXPECT_EQ(felt.turning_doubt(1), FeltWrench::kMostMoment);
    bench.at(bent(7));
    bench.feel(kBias);
    for (int i = 0; i < 500; ++i) felt.update(bench.owned(), true, 0.001);  // the law knows of a contact
    EXPECT_NE(felt.tare(), Tare::taken);
    bench.run(felt, 199);
    EXPECT_NE(felt.tare(), Tare::taken);
    EXPECT_FALSE(felt.waits());
    bench.run(felt, 2);
    ASSERT_EQ(felt.tare(), Tare::taken);
    EXPECT_LT(felt.at_E().norm(), 5e-3);
    EXPECT_EQ(felt.doubt(1) + felt.turning_doubt(1), 0);
  }
}

// A payload of 0.1 kg: at first its weight is taken for a bias; declared, it is gone from the estimate.
// Before, the law felt -1 N from then on. One that is felt and then declared leaves the tare as it was.
TEST(FeltWrench, ALoadThatIsDeclaredIsTaredAgain) {
  for (const double weight : {1.0, 10.0}) {
    Bench bench;
    const JointVector bias = 0.1 * kBias, load = bench.of(six({0, 0, weight}, Vector3::Zero()));
    const bool borne = weight < 3;  // before the start
    bench.feel(borne ? JointVector(bias + load) : bias);
    FeltWrench felt = bench.tared();
    ASSERT_EQ(felt.tare(), Tare::taken);
    bench.feel(bias + load);
    bench.run(felt, 300);
    EXPECT_NEAR(felt.at_E().z(), borne ? 0 : weight, 0.01);
    ++bench.rig.state(0).config_version;  // frames: of no account
    bench.run(felt, 1);
    EXPECT_EQ(felt.tare(), Tare::taken);
    ++bench.rig.state(0).config_version;
    bench.rig.state(0).load.mass = weight / 9.81;
    const Jacobian J = bench.rig.terms(0).J_V_WK();
    const double off = wrench_of(J, borne ? JointVector(bias + load) : bias).force().norm();
    for (int i = 0; i < 1300; ++i) {
      bench.feel(bias + std::max(0.0, 1 - 1e-3 * i) * load);  // as arms take it over
      bench.run(felt, 1);
      if (i == 1000) {  // until then the old one comes off, and contact needs more
        EXPECT_EQ(felt.tare(), Tare::moved);
        EXPECT_NEAR(felt.at_E().z(), borne ? -weight : 0, 0.01);
        EXPECT_NEAR(felt.doubt(1), FeltWrench::kMostForce + off, 0.01);
      }
    }
    EXPECT_EQ(felt.tare(), Tare::taken);
    EXPECT_LT(felt.at_E().norm(), 0.01);
  }
}

// A hand that goes to and fro: the allowance is that of its speed and of its acceleration, 40 ms late.
TEST(FeltWrench, AllowsForMotion) {
  Bench bench;
  bench.feel(JointVector::Zero(7));
  FeltWrench felt;
  felt.start(bench.owned());
  JointVector direction = joint_constant(7, 0);
  direction[1] = 1;
  const double lever = (bench.rig.terms(0).J_V_WE() * direction).head<3>().norm();
  const double w = 2 * M_PI, top = 0.2;  // [rad/s], [m/s]
  double most = 0, least = 1e9;
  for (int i = 0; i < 3000; ++i) {
    bench.at(bent(7), JointVector(top / lever * std::sin(w * 1e-3 * i) * direction));
    felt.update(bench.owned(), false, 0.001);
    if (i == 100) {
      EXPECT_EQ(felt.tare(), Tare::moved);
    }
    if (i < 1000) continue;
    most = std::max(most, felt.motion(1));
    least = std::min(least, felt.motion(1));
  }
  const double lag = 1 / (2 * M_PI * FeltWrench::kCutoff), share = 1 / std::hypot(1, w * lag);
  // 20 |v| + 10 |a|, a quarter of a period apart but for the lag.
  const double speed = 20 * top, acceleration = 10 * top * w * share;
  EXPECT_LT(most, 1.02 * std::hypot(speed, acceleration) + speed * w * lag);
  EXPECT_GT(most, 0.98 * std::max(speed, acceleration));
  EXPECT_GT(least, 0.5 * std::min(speed, acceleration));
  EXPECT_EQ(felt.turning(1), FeltWrench::kLever * felt.motion(1));
}

// In free air with the bias of a real Panda: before, that was a contact, and the law pushed with the whole
// desired force against nothing.
TEST(ForceLaw, DoesNotPressBecauseOfABias) {
  for (const double sign : {1.0, -1.0}) {
    Bench bench;
    bench.feel(sign * kBias);
    Target target;
    target.size = 6;
    const Vector3 felt = bench.rig.state(0).F_K_W_est.force(), n = felt.normalized();
    ASSERT_GT(felt.norm(), 2);  // the threshold that there was
    for (int i = 0; i < 3; ++i) target.values[std::size_t(i)] = 15 * n[i];
    bench.rig.set("press_direction", {n.x(), n.y(), n.z()});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.rig.input("wrench").set(target);
    for (int i = 0; i < 600; ++i) {
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      ASSERT_EQ(bench.rig.output("in_contact")[0], 0) << i;
      ASSERT_EQ(bench.rig.output("force_command_n")[0], 0) << i;
    }
    EXPECT_EQ(bench.rig.output("tare")[0], 1);
    EXPECT_NEAR(bench.rig.output("force_estimated_n")[0], 0, 1e-3);
  }
}

// A surface that is gone: friction of the joints still shows 3.5 N along the motion. Before, that was contact
// for ever, and the arm went on with the whole desired force.
TEST(ForceLaw, NoticesASurfaceThatIsGone) {
  Bench bench;
  const Vector3 n(0, 0, -1);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Target target;
  target.size = 6;
  target.values[2] = -10;
  bench.rig.input("wrench").set(target);
  const auto run = [&](double force, double speed, int ticks) {
    const Jacobian J = bench.rig.terms(0).J_V_WE();
    const Vector6 V = six(speed * n, Vector3::Zero());
    const Eigen::MatrixXd JJt = J * J.transpose();
    bench.at(bent(7), JointVector(J.transpose() * (inverse(JJt) * Eigen::VectorXd(V))));
    bench.feel(bench.of(six(force * n, Vector3::Zero())));
    for (int i = 0; i < ticks; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  };
  run(0, 0, 300);
  run(10, 0, 500);
  ASSERT_EQ(bench.rig.output("in_contact")[0], 1);
  run(3.5, 0.1, 20);
  EXPECT_EQ(bench.rig.output("in_contact")[0], 0);
}

// The same of a law that started in motion, so that the bias of a Panda, here along the pressing direction,
// is not known: before, the law held 2.5 N of bias and 3.5 N of friction for contact. Free and at rest, it
// takes its tare.
TEST(ForceLaw, NoticesASurfaceThatIsGoneAlsoWithoutATare) {
  Bench bench;
  bench.feel(kBias);
  const Vector3 n = bench.rig.state(0).F_K_W_est.force().normalized();
  bench.rig.set("press_direction", {n.x(), n.y(), n.z()});
  const auto desire = [&](double force) {
    Target target;
    target.size = 6;
    for (int i = 0; i < 3; ++i) target.values[std::size_t(i)] = force * n[i];
    bench.rig.input("wrench").set(target);
  };
  const auto place = [&](double force, double speed) {
    const Jacobian J = bench.rig.terms(0).J_V_WE();
    const Vector6 V = six(speed * n, Vector3::Zero());
    const Eigen::MatrixXd JJt = J * J.transpose();
    bench.at(bent(7), JointVector(J.transpose() * (inverse(JJt) * Eigen::VectorXd(V))));
    bench.feel(kBias + bench.of(six(force * n, Vector3::Zero())));
  };
  const auto run = [&](double force, double speed, int ticks) {
    place(force, speed);
    for (int i = 0; i < ticks; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  };
  place(0, 0.1);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  desire(10);
  run(3.5, 0.1, 300);
  EXPECT_EQ(bench.rig.output("in_contact")[0], 0);
  run(10, 0, 500);
  ASSERT_EQ(bench.rig.output("in_contact")[0], 1);
  EXPECT_EQ(bench.rig.output("tare")[0], 2);
  run(3.5, 0.1, 30);
  EXPECT_EQ(bench.rig.output("in_contact")[0], 0);
  desire(0);
  run(0, 0, 500);
  EXPECT_EQ(bench.rig.output("tare")[0], 1);
  EXPECT_NEAR(bench.rig.output("force_estimated_n")[0], 0, 0.01);
}

}  // namespace
}  // namespace multipanda::felt_wrench_test
