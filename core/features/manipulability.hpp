#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Keeps arms away from singular poses. With m = sqrt(det(J J^T)) (core/model/manipulability.hpp):
//   V = k_m (m - m_0)^2 for m <= m_0, otherwise 0;   tau = -dV/dq - d w(m) P dq,
// with P the projector onto self-motions and w = 1 up to m_0, fading to 0 at 1.1 m_0. The damping is an
// addition to the paper's law (d = 0): without it, an elbow without other damping oscillates about the
// maximum of m. The torque is bounded, because |dm/dq| is.
FeatureType manipulability_feature();

}  // namespace multipanda
