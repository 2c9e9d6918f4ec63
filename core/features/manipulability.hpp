#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Keeps arms away from singular poses. With m = sqrt(det(J J^T)) (core/model/manipulability.hpp):
//   V = k_m (m - m_0)^2 for m <= m_0, else 0;   tau = -dV/dq - d w(m) P dq,
// P the projector onto self-motions, w = 1 up to m_0, fading to 0 at 1.1 m_0. The damping is not the paper's
// (d = 0 gives its law): without it an arm whose elbow has no other damping swings about the maximum of m.
// The torque is bounded by the law itself: |dm/dq| is, see there.
FeatureType manipulability_feature();

}  // namespace multipanda
