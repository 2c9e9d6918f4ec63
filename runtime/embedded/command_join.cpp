#include <algorithm>
#include <cmath>

#include "runtime/embedded/hardware_system.hpp"

namespace multipanda {
namespace {

bool all_finite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

using PoseMatrix = Eigen::Map<const Eigen::Matrix4d>;

Matrix3 turned(const Vector3& turn) {
  const double angle = turn.norm();
  if (angle == 0) return Matrix3::Identity();
  return Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
}

}  // namespace

double CommandJoin::fade(double dt) {
  if (time_ >= kFade) return 1;
  const double s = time_ / kFade;
  time_ += dt;
  return s * s * s * (10 + s * (6 * s - 15));  // quintic: no jump in velocity or acceleration
}

CommandJoin::Result CommandJoin::positions(std::span<const double> command, std::span<const double> desired,
                                           double dt, std::span<double> out) {
  if (stage_ == Stage::fresh) {
    std::copy(desired.begin(), desired.end(), hold_.begin());
    stage_ = Stage::waiting;
  }
  if (!all_finite(command)) return Result::not_finite;
  if (stage_ == Stage::waiting) {
    bool near = true;
    for (std::size_t i = 0; i < command.size(); ++i) {
      offset_[i] = hold_[i] - command[i];
      near = near && std::abs(offset_[i]) <= kJointWindow;
    }
    if (!near) {
      std::copy_n(hold_.begin(), out.size(), out.begin());
      return Result::waiting;
    }
    stage_ = Stage::following;
    time_ = 0;
  }
  const double rest = 1 - fade(dt);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = command[i] + rest * offset_[i];
  return Result::following;
}

CommandJoin::Result CommandJoin::velocities(std::span<const double> command, double dt,
                                            std::span<double> out) {
  if (!all_finite(command)) return Result::not_finite;
  if (stage_ == Stage::fresh) stage_ = after_fault_ ? Stage::waiting : Stage::following, time_ = 0;
  if (stage_ == Stage::waiting) {
    const bool rests =
        std::all_of(command.begin(), command.end(), [](double v) { return std::abs(v) <= kRestVelocity; });
    if (!rests) {
      std::fill(out.begin(), out.end(), 0.0);
      return Result::waiting;
    }
    stage_ = Stage::following;
    time_ = 0;
  }
  const double share = fade(dt);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = share * command[i];
  return Result::following;
}

CommandJoin::Result CommandJoin::pose(const std::array<double, 16>& command,
                                      const std::array<double, 16>& desired, double dt,
                                      std::array<double, 16>& out) {
  if (stage_ == Stage::fresh) {
    hold_pose_ = desired;
    stage_ = Stage::waiting;
  }
  if (!all_finite(command)) return Result::not_finite;
  const PoseMatrix target(command.data());
  if (stage_ == Stage::waiting) {
    const PoseMatrix held(hold_pose_.data());
    shift_ = held.block<3, 1>(0, 3) - target.block<3, 1>(0, 3);
    const Eigen::AngleAxisd turn(
        Quaternion(Matrix3(held.block<3, 3>(0, 0) * target.block<3, 3>(0, 0).transpose())).normalized());
    turn_ = turn.angle() * turn.axis();
    if (shift_.norm() > kPositionWindow || std::abs(turn.angle()) > kTurnWindow) {
      out = hold_pose_;
      return Result::waiting;
    }
    stage_ = Stage::following;
    time_ = 0;
  }
  const double rest = 1 - fade(dt);
  out = command;
  if (rest == 0) return Result::following;
  Eigen::Map<Eigen::Matrix4d> sent(out.data());
  sent.block<3, 3>(0, 0) = turned(rest * turn_) * target.block<3, 3>(0, 0);
  sent.block<3, 1>(0, 3) = target.block<3, 1>(0, 3) + rest * shift_;
  return Result::following;
}

}  // namespace multipanda
