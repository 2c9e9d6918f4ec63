#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace multipanda {

// A measurement by the multimode controller inside a controller_manager (runtime/embedded/hosted_trace.hpp)
// that is shown beside a condition of the performance experiment.
struct BesideTrace {
  std::string condition;
  std::filesystem::path file;  // absolute
};

// The measurements that `--beside` names: "CONDITION=FILE", a file <condition>_<number>.npz, or a folder of
// such files. `conditions`: those that run. Throws std::invalid_argument: no such file or condition, or not a
// file of such a measurement.
std::vector<BesideTrace> beside_traces(const std::vector<std::string>& named,
                                       const std::vector<std::string>& conditions);

}  // namespace multipanda
