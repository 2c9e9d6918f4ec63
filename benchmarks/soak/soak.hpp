#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "benchmarks/soak/fault_storm.hpp"
#include "benchmarks/soak/invariants.hpp"
#include "scene/scene.hpp"

namespace multipanda {

struct SoakOptions {
  double duration_s = 120;  // simulated
  std::uint64_t seed = 1;
  double mean_interval_s = 2;                   // between two faults
  bool bare_joints = false;                     // no motor inertia is assumed if the model states none
  std::filesystem::path folder;                 // for the results; exists
  std::function<void(double time_s)> progress;  // about every simulated minute
};

// Measurements at one simulated time.
struct SoakSample {
  double time_s = 0;
  double resident_mb = 0;
  double heap_mb = 0;  // allocated; zero if the allocator does not report it (sanitizers)
  int open_files = 0;
  std::vector<double> work_difference_j;  // by arm, since the start: the program's sum less the arm's
};

struct SoakArm {
  std::string name;
  std::uint64_t periods = 0, periods_missed = 0, motions_ended = 0;
  int longest_miss = 0;
  double torque_rate_max = 0;  // [N m/s]
  double work_j = 0, work_difference_j = 0, work_unseen_j = 0;
};

struct SoakResult {
  std::string scene;
  SoakOptions options;
  double simulated_s = 0, real_s = 0;
  std::uint64_t cycles = 0, requests = 0, recoveries = 0, switches = 0;
  std::uint64_t records_written = 0, records_lost = 0;  // during disk faults
  std::vector<SoakArm> arms;
  std::vector<InjectedFault> faults;
  std::vector<SoakSample> samples;
  std::uint64_t violation_count = 0;
  std::vector<BrokenInvariant> violations;  // the first ones

  bool passed() const { return violation_count == 0; }
};

// Runs a scene on strict virtual arms in simulated time, under faults drawn from the seed, and checks the
// invariants after every cycle: docs/simulation.md. Throws as fci::SimulatedRun does.
SoakResult soak(const Scene& scene, const SoakOptions& options);

// FOLDER/soak.json, for the page.
void write_result(const SoakResult& result, const std::filesystem::path& folder);

}  // namespace multipanda
