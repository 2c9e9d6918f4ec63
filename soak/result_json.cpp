#include <array>
#include <fstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include "soak/soak.hpp"

namespace multipanda {

void write_result(const SoakResult& result, const std::filesystem::path& folder) {
  using Json = nlohmann::ordered_json;
  Json arms = Json::array(), faults = Json::object(), samples = Json::array(), violations = Json::array();
  for (const SoakArm& arm : result.arms)
    arms.push_back({{"name", arm.name},
                    {"periods", arm.periods},
                    {"periods_missed", arm.periods_missed},
                    {"longest_miss", arm.longest_miss},
                    {"motions_ended", arm.motions_ended},
                    {"torque_rate_max_nm_per_s", arm.torque_rate_max},
                    {"work_j", arm.work_j},
                    {"work_difference_j", arm.work_difference_j},
                    {"work_unseen_j", arm.work_unseen_j}});
  for (std::size_t i = 0; i < static_cast<std::size_t>(Fault::count_); ++i)
    faults[std::string(name_of(static_cast<Fault>(i)))] = Json::array();
  for (const InjectedFault& fault : result.faults)
    faults[std::string(name_of(fault.fault))].push_back(fault.at_s);
  for (const SoakSample& sample : result.samples)
    samples.push_back({{"time_s", sample.time_s},
                       {"resident_mb", sample.resident_mb},
                       {"heap_mb", sample.heap_mb},
                       {"open_files", sample.open_files},
                       {"work_difference_j", sample.work_difference_j}});
  for (const BrokenInvariant& violation : result.violations)
    violations.push_back({{"at_s", violation.at_s}, {"what", violation.what}});
  const Json all{{"scene", result.scene},
                 {"seed", result.options.seed},
                 {"bare_joints", result.options.bare_joints},
                 {"simulated_s", result.simulated_s},
                 {"real_s", result.real_s},
                 {"cycles", result.cycles},
                 {"switches", result.switches},
                 {"requests", result.requests},
                 {"recoveries", result.recoveries},
                 {"records_written", result.records_written},
                 {"records_lost", result.records_lost},
                 {"passed", result.passed()},
                 {"violation_count", result.violation_count},
                 {"violations", violations},
                 {"arms", arms},
                 {"faults", faults},
                 {"samples", samples}};
  const std::filesystem::path file = folder / "soak.json";
  std::ofstream out(file);
  out << all.dump(1) << '\n';
  out.close();
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

}  // namespace multipanda
