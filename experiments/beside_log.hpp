#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"

namespace multipanda {

// A log of arms that is shown beside the simulated runs of a variant.
struct BesideLog {
  const ExperimentVariant* variant = nullptr;
  std::size_t repeat = 1;
  std::filesystem::path log;
};

// The logs that `--beside` names: "VARIANT=LOG", "LOG" if only one variant runs, or the folder of an
// experiment on arms, which has a log of each variant and repeat. Throws std::invalid_argument: no such log
// or variant.
std::vector<BesideLog> beside_logs(const std::vector<std::string>& named,
                                   const std::vector<const ExperimentVariant*>& variants);

// Exports the log to `folder`/data, and returns the run as the page's plan has it. `like`: the same variant's
// run in simulation. The timeline is that of the scene in the log. Throws std::runtime_error (unreadable) or
// std::invalid_argument (another scene's arms).
nlohmann::ordered_json beside_run(const BesideLog& log, const nlohmann::ordered_json& like,
                                  const std::filesystem::path& folder);

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
