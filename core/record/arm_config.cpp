#include "core/record/arm_config.hpp"

#include <algorithm>

namespace multipanda {
namespace {

constexpr std::size_t kPose = 7, kLoad = 10;

Load load_at(const double* v) {
  Load load{.mass = v[0], .p_FC = {v[1], v[2], v[3]}};
  load.inertia_C << v[4], v[5], v[6], v[5], v[7], v[8], v[6], v[8], v[9];
  return load;
}

}  // namespace

void put_arm_config(Event& event, const ArmFrames& frames, const Load& tool, const Load& load) {
  event.kind = EventKind::arm_config;
  event.size = 2 * kPose + 2 * kLoad;
  double* to = event.values.data();
  for (const Pose* X : {&frames.X_FE, &frames.X_EK}) to = std::ranges::copy(X->values(), to).out;
  for (const Load* body : {&tool, &load}) {
    const Vector3& p = body->p_FC;
    const Matrix3& I = body->inertia_C;
    const std::array<double, kLoad> numbers{body->mass, p.x(),   p.y(),   p.z(),   I(0, 0),
                                            I(0, 1),    I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
    to = std::ranges::copy(numbers, to).out;
  }
}

bool read_arm_config(const Event& event, ArmFrames& frames, Load& tool, Load& load) {
  if (event.kind != EventKind::arm_config) return false;
  const double* v = event.values.data();
  frames = {Pose::from(v), Pose::from(v + kPose)};
  tool = load_at(v + 2 * kPose);
  load = load_at(v + 2 * kPose + kLoad);
  return true;
}

}  // namespace multipanda
