#pragma once

#include <memory>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/state/arm_state.hpp"
#include "scene/scene.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// Rebuilds the scene of a log. Throws std::runtime_error or ConfigError with the reason.
Scene rebuild_scene(const std::string& text, const std::string& path);

// Frames, tool and load of an arm from one sample on.
struct ConfigFrom {
  Eigen::Index sample = 0;
  ArmFrames frames;
  Load tool, load;
};

// Computes x_EE, quat_EE and gravity at every sample if the log has none.
void complete_from_model(MeasuredLog& log, std::shared_ptr<const ArmModel> model,
                         const std::vector<ConfigFrom>& configs);

}  // namespace multipanda
