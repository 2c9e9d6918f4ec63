#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// The features of multipanda; each is stated above its class.
FeatureType joint_limits_feature();
FeatureType collision_avoidance_feature();
FeatureType manipulability_feature();
FeatureType friction_compensation_feature();

}  // namespace multipanda
