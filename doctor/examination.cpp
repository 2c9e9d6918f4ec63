#include "doctor/examination.hpp"

#include <algorithm>
#include <cmath>

#include "common/machine.hpp"
#include "doctor/arm_stream.hpp"
#include "doctor/computer.hpp"

namespace multipanda::doctor {

Purpose purpose_of(const std::vector<std::string>& addresses) {
  return std::all_of(addresses.begin(), addresses.end(), is_on_this_computer) ? Purpose::simulated_arms
                                                                              : Purpose::real_arms;
}

std::vector<Finding> examine(const ExaminationOptions& options,
                             const std::function<void(const Finding&)>& show) {
  const SystemFiles files;
  const Purpose purpose = options.purpose.value_or(purpose_of(options.addresses));
  std::vector<Finding> findings;
  const auto add = [&](Finding finding) {
    show(finding);
    findings.push_back(std::move(finding));
  };
  const MachineKindReading kind = read_machine_kind(files);
  add(judge_virtual_machine(kind, purpose));
  add(judge_kernel(read_kernel(files), purpose));
  const SchedulingReading scheduling = read_scheduling(files);
  add(judge_fifo(scheduling, purpose));
  add(judge_memory_lock(scheduling, purpose));
  add(judge_throttling(scheduling, purpose));
  const ProcessorReading processor = read_processor(files);
  add(judge_governor(processor, purpose));
  add(judge_idle_states(processor, purpose));
  add(judge_clock_source(kind, purpose));

  // Load during the timer measurement, which explains its figures.
  const LoadSample before = sample_load(files);
  const TimerReading timer = read_timer(options.seconds);
  const LoadSample after = sample_load(files);
  const LoadReading load = load_between(before, after, files);
  add(judge_load(load, purpose));
  add(judge_isolation(load, purpose));
  add(judge_steal(load, purpose));
  add(judge_timer(timer, purpose));

  // As many cycles as take about `seconds` at 1 kHz; unpaced they take a fraction of it.
  const auto cycles = static_cast<std::uint64_t>(std::clamp(options.seconds * 1000, 500.0, 60000.0));
  const ControlCycleReading cycle = read_control_cycle(options.scene, cycles);
  add(judge_control_cycle(cycle, purpose));
  add(judge_loop_guard(cycle, purpose));
  add(judge_dds(read_dds(before, after, files), purpose));
  for (const auto& address : options.addresses) {
    const NetworkCardReading card = read_network_card(address, files);
    add(judge_network_card(card, purpose));
    if (card.interface.empty()) continue;
    add(judge_round_trip(read_round_trip(address, options.seconds), purpose));
    const ArmStreamReading stream = read_arm_stream(address, options.seconds);
    add(judge_arm_version(stream, purpose));
    add(judge_state_stream(stream, purpose));
  }
  return findings;
}

}  // namespace multipanda::doctor
