#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/types/joints.hpp"
#include "models/robot_description.hpp"
#include "sysid/excitation/excitation_motion.hpp"

namespace multipanda {

// Inverse dynamics of a chain as a matrix times its links' parameters, tau = Y(q, dq, ddq) phi. Each moving
// link has [m, m c_x, m c_y, m c_z, Ixx, Ixy, Iyy, Ixz, Iyz, Izz] in its frame, inertia about the frame's
// origin. Newton-Euler per link, projected on the joints' axes:
//   f = m a + alpha x mc + omega x (omega x mc),  n = mc x a + I alpha + omega x I omega,
// with a the acceleration of the frame's origin less gravity. One instance per thread.
class DynamicsRegressor {
 public:
  // Level base, gravity 9.81 m/s^2 along its -z. The last link includes what is behind it (hand, tool).
  explicit DynamicsRegressor(const RobotDescription& robot);

  std::size_t joints() const { return X_.size(); }
  // Y (n x 10 n). All vectors (n x 1) [rad], [rad/s], [rad/s^2].
  const Eigen::MatrixXd& evaluate(const JointVector& q, const JointVector& dq, const JointVector& ddq);

 private:
  std::vector<Pose> X_;  // of joint frames at zero, in the preceding link
  std::vector<Vector3> p_, z_;
  Eigen::MatrixXd Y_;
};

// phi of a robot's links (10 n x 1); the last one includes the hand, if the robot has one and `hand` is set.
Eigen::VectorXd link_parameters(const RobotDescription& robot, bool hand);

// How well motions distinguish the base parameters of a robot: the condition number of the
// regressor's independent columns, each scaled to unit length over the motion. 1 would be perfect.
// One instance per thread.
class BaseCondition {
 public:
  // Finds the independent columns at random states (fixed seed): as many as the chain has base parameters.
  explicit BaseCondition(const RobotDescription& robot);

  std::size_t parameters() const { return columns_.size(); }
  const std::vector<Eigen::Index>& columns() const { return columns_; }  // of the whole regressor
  void begin();                                                          // discards the samples
  void add(const JointVector& q, const JointVector& dq, const JointVector& ddq);
  double value() const;  // of the samples so far; infinite if a column is zero in all of them

 private:
  DynamicsRegressor regressor_;
  std::vector<Eigen::Index> columns_;
  Eigen::MatrixXd chosen_, gram_;
};

// Motions that excite the base parameters of an arm (docs/identification.md).

struct ExcitationOptions {
  double period = 8, cycles = 2, ramp = 1;  // of the base frequency [s], [1], [s]
  std::size_t parts = 6;                    // harmonics, 1 to 1 + kMaxHarmonics
  bool hand = true;                         // on the flange, if the robot has one
  ExcitationLimits limits;
  std::uint64_t seed = 1;
  std::size_t random_motions = 100;  // feasible ones; the search starts at the best of them
  std::size_t evaluations = 16000;
  std::size_t threads = 2;  // changes the computing time only
  std::function<void(const std::string& line)> progress;
  const std::atomic<bool>* stop = nullptr;  // true: stop with the best motion so far
};

struct Excitation {
  ExcitationMotion motion;
  double condition = 0;                         // of the base regressor, columns scaled
  double random_best = 0, random_median = 0;    // of the random feasible motions
  std::vector<LimitUse> use;                    // every limit, at each millisecond
  std::size_t parameters = 0, evaluations = 0;  // number of base parameters; motions tried
};

// Random motions within every limit: around the home configuration. Each joint's amplitude is a random
// fraction of what its limits allow; all are scaled down together if the arm would exceed a limit. Throws
// std::runtime_error if too few candidates are feasible.
std::vector<ExcitationMotion> random_motions(const RobotDescription& robot, const ExcitationOptions& options);

// The condition number of the base regressor over one base period at full rate.
double condition_of(BaseCondition& condition, const ExcitationMotion& motion);

// Takes about a minute on two cores. Throws std::invalid_argument (options) and std::runtime_error (no
// feasible motion).
Excitation optimize_excitation(const RobotDescription& robot, const ExcitationOptions& options);

// A scene file whose only arm, of `model` (a name or a path), goes to the motion's start, moves, and rests.
// It runs on every backend: the rotors that the model states act, and the law knows them, or they would swing
// on its springs. `note` becomes a comment.
std::string excitation_scene(const Excitation& excitation, const RobotDescription& robot,
                             const std::string& model, bool hand, const std::string& note);

// Gains of the joint impedance in that scene, as text of its `parameters`. Soft enough for arms with 3 ms
// delay and 30 Hz torque bandwidth, including a light last joint; stiff enough that friction and an unknown
// payload cause errors of a few hundredths of a radian.
std::string excitation_gains(std::size_t joints);

// Start time of the motion in that scene [s]; until then the arm moves to the start.
inline constexpr double kExcitationBegins = 5, kExcitationApproach = 4;

// Timeline events (items of a YAML list): the move to `q`, then the motion.
std::string reference_event(double at_s, const std::string& controllet, const JointVector& q);
std::string motion_event(double at_s, const std::string& controllet, const ExcitationMotion& motion);

// Covariance matrix adaptation (Hansen, "The CMA evolution strategy: a tutorial", 2016, default constants).
// It minimizes a function of some dozens of variables that may be curved, narrow and not smooth. The same
// seed gives the same search, whatever the number of threads.
class Evolution {
 public:
  // `scale`: initial standard deviation of each variable (n x 1), above zero.
  Evolution(const Eigen::VectorXd& start, const Eigen::VectorXd& scale, std::uint64_t seed);

  // The next candidates (n x 1 each), and their values in the same order; infinite is the worst.
  std::vector<Eigen::VectorXd> ask();
  void tell(const std::vector<double>& values);

 private:
  double normal();

  Eigen::Index n_;
  std::size_t population_, parents_;
  Eigen::VectorXd weights_, scale_, mean_, path_sigma_, path_c_, deviations_;
  Eigen::MatrixXd C_, axes_;
  double mu_eff_, c_sigma_, d_sigma_, c_c_, c_1_, c_mu_, chi_, sigma_ = 1;
  std::size_t generation_ = 0;
  std::vector<Eigen::VectorXd> steps_;
  std::mt19937_64 bits_;
};

// values[i] = function(thread, i) for i < count, on the given number of threads.
void for_all(std::size_t count, std::size_t threads,
             const std::function<void(std::size_t thread, std::size_t i)>& function);

}  // namespace multipanda
