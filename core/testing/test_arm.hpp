#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "core/model/arm_model.hpp"

namespace multipanda::test {

// One moving link of a synthetic arm, as plain numbers, from which tests compute kinematics
// and dynamics independently.
struct TestLink {
  Pose X_PJ;     // joint frame in the parent's frame, at q = 0
  Vector3 axis;  // of rotation, in the joint frame, unit length
  double mass;   // [kg]
  Vector3 p_JC;  // center of mass in the joint frame [m]
  Matrix3 inertia_C;
};

// A synthetic serial arm: seven joints (or any number), skewed axes, no symmetry that could hide
// a wrong sign.
struct TestArm {
  std::vector<TestLink> links;
  Pose X_JF;  // flange in the last joint's frame

  static TestArm make(std::size_t joints = 7, std::uint32_t seed = 1);
  std::string urdf() const;
  ArmModelSource source(const Pose& X_WB = {}, const std::string& name = "test") const;
  std::shared_ptr<const ArmModel> model(const Pose& X_WB = {}, const std::string& name = "test") const;
};

// Adds seeded collision shapes of every kind: one or two on every body, including the base. Bodies that are
// not neighbors are checked against each other.
void add_collision_shapes(ArmModelSource& source, std::size_t joints, std::uint32_t seed);

// Seeded draws. Compilers order a call's arguments differently: draw in braces, or one by one.
class Draw {
 public:
  explicit Draw(std::uint32_t seed) : engine_(seed) {}
  double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }
  std::size_t index(std::size_t count) {
    return std::uniform_int_distribution<std::size_t>(0, count - 1)(engine_);
  }
  bool coin() { return index(2) == 1; }
  Vector3 vector3(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  Matrix3 rotation();
  Pose pose(double size) { return {rotation(), vector3(size)}; }
  JointVector joints(std::size_t n, double size);
  Load load(double mass);  // a physically consistent body of that mass near the flange

 private:
  std::mt19937 engine_;
};

}  // namespace multipanda::test
