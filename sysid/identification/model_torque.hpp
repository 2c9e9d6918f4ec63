#pragma once

#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/predict.hpp"

namespace multipanda {

// What the torque sensors should have shown at the kept rows (N x n) [N m]:
//   gain (Y theta + protocol_filter(friction)) + offset.
Eigen::MatrixXd model_torque(const FilteredLog& log, const RobotDescription& robot,
                             const PredictOptions& options);

}  // namespace multipanda
