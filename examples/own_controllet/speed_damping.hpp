#pragma once

#include "core/features/feature.hpp"

// A user's own feature: damps every joint that moves faster than a given speed, whatever controls the arm.
//   tau_i -= d max(0, |dq_i| - v_0) sign(dq_i)
multipanda::FeatureType speed_damping_feature();
