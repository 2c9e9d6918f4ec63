#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "scene/scene.hpp"
#include "soak/fault.hpp"
#include "soak/invariants.hpp"

namespace multipanda {

struct SoakOptions {
  double duration_s = 120;  // simulated
  std::uint64_t seed = 1;
  double mean_interval_s = 2;                   // between two faults
  bool bare_joints = false;                     // no motor inertia is assumed where a model states none
  std::filesystem::path folder;                 // for the results; exists
  std::function<void(double time_s)> progress;  // about every simulated minute
};

// What was measured from one simulated time to the next.
struct SoakSample {
  double time_s = 0;
  double resident_mb = 0;
  double heap_mb = 0;  // allocated; zero where the allocator does not tell (sanitizers)
  int open_files = 0;
  std::vector<double> work_difference_j;  // by arm, since the start: booked by the program less by the arm
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
  std::uint64_t records_written = 0, records_lost = 0;  // during trouble of the disk
  std::vector<SoakArm> arms;
  std::vector<InjectedFault> faults;
  std::vector<SoakSample> samples;
  std::uint64_t violation_count = 0;
  std::vector<BrokenInvariant> violations;  // the first ones

  bool passed() const { return violation_count == 0; }
};

// Runs a scene on strict virtual arms in simulated time, under faults drawn from the seed, and checks the
// invariants after every cycle: docs/soak.md. Throws as fci::SimulatedRun does.
SoakResult soak(const Scene& scene, const SoakOptions& options);

// FOLDER/soak.json, for the page.
void write_result(const SoakResult& result, const std::filesystem::path& folder);

}  // namespace multipanda
