// The desired motion: the published quantities, and which commands the arm refuses. Expected numbers come
// from formulas of motions, and from a separate client that uses only published data.
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/motion_rig.hpp"
#include "core/testing/full_series.hpp"

namespace multipanda::motion_generator_test {
namespace {

using test::Draw;
constexpr double dt = 0.001;

struct Rig {
  explicit Rig(const std::string& name, const Pose& X_FE = {}, bool any_joints = false)
      : robot(load_robot(name)),
        model(std::make_shared<const ArmModel>(arm_model_source(robot, Draw(3).pose(1), false))),
        limits(MotionLimits::of(robot)) {
    if (any_joints) {  // only the Cartesian rules
      test::any_joints(limits);
      limits.q_min.setConstant(-1e3);
      limits.q_max.setConstant(1e3);
    }
    motion.emplace(model, limits);
    motion->hold(model->q_home(), X_FE);
  }
  MotionStart start(MotionGenerator generator) {
    return motion->start({.controller = ArmController::joint_impedance, .generator = generator});
  }
  const DesiredState& state() const { return motion->state(); }
  std::vector<ArmError> errors() const {
    std::vector<ArmError> found;
    for (const Violation& v : motion->violations()) found.push_back(v.error);
    return found;
  }
  RobotDescription robot;
  std::shared_ptr<const ArmModel> model;
  MotionLimits limits;
  std::optional<DesiredMotion> motion;
};

int long_series(int steps) { return test::full_series() ? 10 * steps : steps; }

// A motion from 0 to `size` and back to 0 in `duration`, at rest at both ends to the second derivative.
double bump(double t, double duration, double size) {
  const double s = std::clamp(t / duration, 0.0, 1.0);
  return size * 64 * std::pow(s * (1 - s), 3);
}

TEST(DesiredMotion, PublishesBackwardDifferencesOfJointPositions) {
  Rig rig("fr3", Draw(5).pose(0.1));
  const JointVector q0 = rig.state().q;
  KinematicChain chain(rig.model);
  chain.set_end_effector(Draw(5).pose(0.1));
  ASSERT_EQ(rig.start(MotionGenerator::joint_position), MotionStart::started);
  const auto q_of = [&](int k) -> JointVector {
    JointVector q = q0;
    for (Eigen::Index i = 0; i < 7; ++i) q[i] += bump(k * dt, 2.0, 0.05 * static_cast<double>(i + 1));
    return q;
  };
  for (int k = 1; k <= 2000; ++k) {
    const InterfaceCommand command = test::positions(q_of(k));
    ASSERT_EQ(rig.motion->step(&command), MotionStep::moving) << k;
    const DesiredState& s = rig.state();
    const JointVector now = q_of(k), before = q_of(std::max(k - 1, 0)), earlier = q_of(std::max(k - 2, 0));
    EXPECT_EQ(s.q, now);
    EXPECT_LT((s.dq - (now - before) / dt).norm(), 1e-12);
    EXPECT_LT((s.ddq - (now - 2 * before + earlier) / (dt * dt)).norm(), 1e-9);
    EXPECT_LT(pose_error(s.X_BE_d, chain.X_BE(now)).norm(), 1e-14);
    EXPECT_EQ(s.X_BE_c.position, s.X_BE_d.position);
    EXPECT_EQ(s.V_BE_c.vector.norm(), 0);
    Jacobian J;
    chain.X_BE(0.5 * (now + before), J);  // the mean velocity, to second order
    EXPECT_LT((s.V_BE_d.vector - J * s.dq).norm(), 1e-5);
    EXPECT_EQ(s.elbow_d, elbow_of(now));
  }
  InterfaceCommand last = test::positions(q_of(2001));
  last.motion_finished = true;
  EXPECT_EQ(rig.motion->step(&last), MotionStep::at_rest);
}

// --- a client that uses only published data, in single precision, and limits its commands itself ---

// Franka's constants less their margin: 1e-3, and for velocities what `lost` missed packets may add.
struct ClientLimits {
  double velocity, acceleration, jerk;
  ClientLimits(double v, double a, double j, int lost)
      : velocity(v - 1e-3 - lost * dt * a), acceleration(a - 1e-3), jerk(j - 1e-3) {}
};

double single(double x) { return static_cast<double>(static_cast<float>(x)); }
template <typename V>
V single(const V& x) {
  return x.template cast<float>().template cast<double>();
}

// Next velocity towards v_desired from the published velocity and acceleration: jerk first, then the
// acceleration, which decreases linearly as the velocity approaches its limits.
double limited(double v_desired, double v, double a, const ClientLimits& l, double upper, double lower) {
  double next = std::clamp((v_desired - v) / dt, a - l.jerk * dt, a + l.jerk * dt);
  const double slope = l.jerk / l.acceleration;
  next = std::min(next, std::min(l.acceleration, slope * (upper - v)));
  next = std::max(next, std::max(-l.acceleration, slope * (lower - v)));
  return v + next * dt;
}

// The same for vectors by their lengths: the acceleration ends where it would leave the sphere of velocities.
Vector3 limited(const Vector3& v_desired, const Vector3& v, const Vector3& a, const ClientLimits& l) {
  Vector3 jerk = ((v_desired - v) / dt - a) / dt;
  if (jerk.norm() > l.jerk) jerk *= l.jerk / jerk.norm();
  const Vector3 next = a + dt * jerk;
  const double size = next.norm();
  if (size < 1e-12) return v;
  const Vector3 direction = next / size;
  const double along = direction.dot(v);
  const double room = std::sqrt(std::max(0.0, along * along - v.squaredNorm() + l.velocity * l.velocity));
  const double most = std::min(l.acceleration, l.jerk / l.acceleration * (room - along));
  return v + dt * std::min(size, most) * direction;
}

struct JointClientFigures {
  const char* robot;
  int lost;  // packets that its library assumes
};
const JointClientFigures kFr3Client{"fr3", 0}, kPandaClient{"fer", 3};

// One step of a joint client: velocity per joint, from the published state.
JointVector client_velocity(const Rig& rig, const JointVector& target, double gain, int lost) {
  const JointVector q = single(rig.state().q), dq = single(rig.state().dq), ddq = single(rig.state().ddq);
  JointVector v(q.size());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const ClientLimits l(rig.limits.dq_max[i], rig.limits.ddq_max[i], rig.limits.dddq_max[i], lost);
    const double tighter = rig.limits.dq_max[i] - l.velocity;
    v[i] = limited(gain * (target[i] - q[i]), dq[i], ddq[i], l,
                   std::max(0.0, rig.limits.upper_velocity(i, q[i]) - tighter),
                   std::min(0.0, rig.limits.lower_velocity(i, q[i]) + tighter));
  }
  return v;
}

JointVector draw_target(Draw& draw, const MotionLimits& limits) {
  JointVector q(7);
  for (Eigen::Index i = 0; i < 7; ++i) {
    q[i] = draw.uniform(limits.q_min[i] + 0.35, limits.q_max[i] - 0.35);
    // Joints 5 and 7 of the FR3 need more deceleration near the ends (17 rad/s^2) than they may command (10):
    // a limiter that looks one step ahead cannot keep both limits. They stay where the velocity limit does
    // not depend on position.
    if (limits.deceleration.size() != 0 && (i == 4 || i == 6)) q[i] = draw.uniform(-1.2, 1.2);
  }
  return q;
}

class JointClient : public testing::TestWithParam<JointClientFigures> {};

TEST_P(JointClient, WithFrankasLimitsIsNeverRefused) {
  for (const MotionGenerator generator : {MotionGenerator::joint_position, MotionGenerator::joint_velocity}) {
    Rig rig(GetParam().robot);
    ASSERT_EQ(rig.start(generator), MotionStart::started);
    Draw draw(77);
    JointVector target = draw_target(draw, rig.limits), fastest = JointVector::Zero(7), strongest = fastest;
    double gain = 5;
    int trap = 0;  // commands that the exact history alone would have refused
    for (int k = 0; k < long_series(20000); ++k) {
      if (draw.index(700) == 0) {
        target = draw_target(draw, rig.limits);
        gain = draw.uniform(1, 6);
      }
      const JointVector v = client_velocity(rig, target, gain, GetParam().lost);
      const JointVector q_published = single(rig.state().q);
      const InterfaceCommand command = generator == MotionGenerator::joint_position
                                           ? test::positions(q_published + dt * v)
                                           : test::velocities(v);
      const DesiredState before = rig.state();
      ASSERT_EQ(rig.motion->step(&command), MotionStep::moving)
          << "step " << k << ": " << describe(rig.motion->violations()[0]);
      fastest = fastest.cwiseMax(rig.state().dq.cwiseAbs());
      strongest = strongest.cwiseMax(rig.state().ddq.cwiseAbs());
      const JointVector jerk = (rig.state().ddq - before.ddq) / dt;
      trap += (jerk.cwiseAbs().array() > rig.limits.dddq_max.array()).any() ||
              (rig.state().ddq.cwiseAbs().array() > rig.limits.ddq_max.array()).any();
    }
    // The limits were reached, and checking against the exact history alone would have refused commands.
    EXPECT_TRUE((strongest.array() > 0.95 * rig.limits.ddq_max.array()).all()) << strongest.transpose();
    EXPECT_TRUE((fastest.array() > 0.7 * rig.limits.dq_max.array()).any()) << fastest.transpose();
    if (generator == MotionGenerator::joint_position) {
      EXPECT_GT(trap, 100);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, JointClient, testing::Values(kFr3Client, kPandaClient),
                         [](const auto& p) { return std::string(p.param.robot); });

// Poses around the start; and elbows near theirs.
struct CartesianTarget {
  Pose X;
  double elbow = 0, gain = 4;
};

struct CartesianStep {
  Vector6 V;
  double delbow;
};

CartesianStep client_twist(const Rig& rig, const CartesianTarget& target, int lost, double share) {
  const CartesianLimits& c = rig.limits.cartesian;
  const double jerk = share < 1 ? 0.1 : 1.0;  // what the joints bear
  const ClientLimits linear(share * c.velocity, share * c.acceleration, jerk * c.jerk, lost),
      angular(share * c.rotation_velocity * 0.99, share * c.rotation_acceleration, jerk * c.rotation_jerk,
              lost),
      elbow(share * c.elbow_velocity, share * c.elbow_acceleration, jerk * c.elbow_jerk, lost);
  const DesiredState& s = rig.state();
  const Vector6 V = single(s.V_BE_c.vector), A = single(s.A_BE_c);
  const Vector3 p = single(s.X_BE_c.position);
  const Matrix3 R = single(s.X_BE_c.rotation);
  // Where a vector's acceleration turns while its velocity is being limited, Franka's rule exceeds the
  // jerk (up to sqrt(2)): this client requests less than the greatest velocity, so that jerk and acceleration
  // limit it.
  const auto requested = [&](const Vector3& way, const ClientLimits& l) -> Vector3 {
    const Vector3 v = target.gain * way;
    return v * std::min(1.0, 0.95 * l.velocity / std::max(v.norm(), 1e-9));
  };
  CartesianStep step;
  step.V.head<3>() = limited(requested(target.X.position - p, linear), V.head<3>(), A.head<3>(), linear);
  step.V.tail<3>() = limited(requested(log_rotation(target.X.rotation * R.transpose()), angular), V.tail<3>(),
                             A.tail<3>(), angular);
  step.delbow = limited(target.gain * (target.elbow - single(s.elbow_c[0])), single(s.delbow_c[0]),
                        single(s.ddelbow_c[0]), elbow, elbow.velocity, -elbow.velocity);
  return step;
}

struct CartesianClientFigures {
  const char* robot;
  int lost;
  bool any_joints;  // only Cartesian rules, at their limits; else gently, with all rules
};

class CartesianClient : public testing::TestWithParam<CartesianClientFigures> {};

TEST_P(CartesianClient, WithFrankasLimitsIsNeverRefused) {
  const auto figures = GetParam();
  for (const MotionGenerator generator :
       {MotionGenerator::cartesian_pose, MotionGenerator::cartesian_velocity}) {
    for (const bool with_elbow : {true, false}) {
      Rig rig(figures.robot, Draw(5).pose(0.05), figures.any_joints);
      ASSERT_EQ(rig.start(generator), MotionStart::started);
      Draw draw(78);
      const Pose X_start = rig.state().X_BE_c;
      const double elbow_start = rig.state().elbow_c[0];
      CartesianTarget target{X_start, elbow_start};
      double strongest = 0, strongest_turn = 0;
      const double reach = figures.any_joints ? 0.15 : 0.1;
      for (int k = 0; k < long_series(6000); ++k) {
        if (draw.index(400) == 0) {
          target.X.position = X_start.position + draw.vector3(reach);
          target.X.rotation = exp_rotation(draw.vector3(reach * 2)) * X_start.rotation;
          target.elbow = elbow_start + draw.uniform(-0.3, 0.3);
          target.gain = draw.uniform(2, 6);
        }
        const CartesianStep step = client_twist(rig, target, figures.lost, figures.any_joints ? 1.0 : 0.04);
        const DesiredState& s = rig.state();
        InterfaceCommand command;
        if (generator == MotionGenerator::cartesian_pose) {
          // Built on the published matrix, which is not an exact rotation.
          const Matrix3 R = single(s.X_BE_c.rotation);
          const Vector3 p = single(s.X_BE_c.position);
          command = test::pose({exp_rotation(dt * step.V.tail<3>()) * R, p + dt * step.V.head<3>()});
        } else {
          command.O_dP_EE_c = step.V;
        }
        command.has_elbow = with_elbow;
        command.elbow_c = {single(s.elbow_c[0]) + dt * step.delbow, s.elbow_d[1]};
        ASSERT_EQ(rig.motion->step(&command), MotionStep::moving)
            << "step " << k << ": " << describe(rig.motion->violations()[0]);
        ASSERT_LT(pose_error(s.X_BE_c, s.X_BE_d).norm(), 1e-9);
        ASSERT_LT((s.X_BE_c.rotation.transpose() * s.X_BE_c.rotation - Matrix3::Identity()).norm(), 1e-13);
        if (with_elbow) {
          ASSERT_NEAR(s.elbow_d[0], command.elbow_c[0], 1e-9);
        }
        strongest = std::max(strongest, s.A_BE_c.head<3>().norm());
        strongest_turn = std::max(strongest_turn, s.A_BE_c.tail<3>().norm());
      }
      const double share = figures.any_joints ? 0.95 : 0.035;
      EXPECT_GT(strongest, share * rig.limits.cartesian.acceleration);
      EXPECT_GT(strongest_turn, share * rig.limits.cartesian.rotation_acceleration);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Arms, CartesianClient,
    testing::Values(CartesianClientFigures{"fr3", 0, true}, CartesianClientFigures{"fer", 3, true},
                    CartesianClientFigures{"fr3", 0, false}, CartesianClientFigures{"fer", 3, false}),
    [](const auto& p) {
      return std::string(p.param.robot) + (p.param.any_joints ? "_at_the_limits" : "_gently");
    });

// --- Exact motions as in Franka's example programs ---

// command(t, start) for t = 0, 1 ms, ... until `duration`; then finished with the last one.
MotionStep run(Rig& rig, MotionGenerator generator, double duration,
               const std::function<InterfaceCommand(double, const DesiredState&)>& command) {
  EXPECT_EQ(rig.start(generator), MotionStart::started);
  const DesiredState start = rig.state();
  MotionStep step = MotionStep::moving;
  for (int k = 0; step == MotionStep::moving; ++k) {
    InterfaceCommand c = command(k * dt, start);
    c.motion_finished = k * dt >= duration;
    step = rig.motion->step(&c);
    EXPECT_NE(step, MotionStep::violation) << k << ": " << describe(rig.motion->violations()[0]);
  }
  return step;
}

TEST(DesiredMotion, AllowsTheMotionsOfOrdinaryPrograms) {
  for (const char* name : {"fr3", "fer"}) {
    Rig rig(name, Draw(9).pose(0.02));
    // Three joints back and forth by 45 degrees in 5 s.
    EXPECT_EQ(run(rig, MotionGenerator::joint_position, 5,
                  [&](double t, const DesiredState& start) {
                    JointVector q = start.q;
                    for (const Eigen::Index i : {3, 4, 6}) q[i] += M_PI / 8 * (1 - std::cos(M_PI / 2.5 * t));
                    return test::positions(q);
                  }),
              MotionStep::at_rest);
    // Four joints at up to 1 rad/s, one second in each direction.
    EXPECT_EQ(run(rig, MotionGenerator::joint_velocity, 2,
                  [&](double t, const DesiredState&) {
                    JointVector dq = JointVector::Zero(7);
                    dq.tail<4>().setConstant((t < 1 ? 0.5 : -0.5) * (1 - std::cos(2 * M_PI * t)));
                    return test::velocities(dq);
                  }),
              MotionStep::at_rest);
    // An arc of 0.3 m radius and back in 10 s, orientation held, elbow free.
    EXPECT_EQ(run(rig, MotionGenerator::cartesian_pose, 10,
                  [&](double t, const DesiredState& start) {
                    const double angle = M_PI / 4 * (1 - std::cos(M_PI / 5 * t));
                    Pose X = start.X_BE_c;
                    X.position += Vector3(0.3 * std::sin(angle), 0, 0.3 * (std::cos(angle) - 1));
                    return test::pose(X);
                  }),
              MotionStep::at_rest);
    // The same by velocity, 0.1 m/s obliquely down and up again in 8 s.
    EXPECT_EQ(run(rig, MotionGenerator::cartesian_velocity, 8,
                  [&](double t, const DesiredState&) {
                    InterfaceCommand c;
                    const double v = (t < 4 ? 0.05 : -0.05) * (1 - std::cos(M_PI / 2 * t));
                    c.O_dP_EE_c << v * std::cos(M_PI / 4), 0, -v * std::sin(M_PI / 4), 0, 0, 0;
                    return c;
                  }),
              MotionStep::at_rest);
    // The elbow alone, by 36 degrees and back in 10 s.
    const DesiredState before = rig.state();
    EXPECT_EQ(
        run(rig, MotionGenerator::cartesian_pose, 10,
            [&](double t, const DesiredState& start) {
              InterfaceCommand c = test::pose(start.X_BE_c);
              c.has_elbow = true;
              c.elbow_c = {start.elbow_c[0] + M_PI / 10 * (1 - std::cos(M_PI / 5 * t)), start.elbow_c[1]};
              return c;
            }),
        MotionStep::at_rest);
    EXPECT_LT(pose_error(before.X_BE_c, rig.state().X_BE_d).norm(), 1e-6);
    EXPECT_LT((before.q - rig.state().q).norm(), 1e-5);
  }
}

}  // namespace
}  // namespace multipanda::motion_generator_test
