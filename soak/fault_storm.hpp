#pragma once

#include <array>
#include <deque>
#include <functional>
#include <future>
#include <vector>

#include "fci/simulated_time/draw.hpp"
#include "fci/simulated_time/simulated_run.hpp"
#include "soak/fault.hpp"

namespace multipanda {

// Injects faults into a run, one after the other or several at once, all drawn from a seed; and does what a
// user would do afterwards: releases, plugs in, recovers, switches back. Calls belong to the run's thread.
class FaultStorm {
 public:
  // `mean_interval_s`: between two faults. `disk`: carries out the faults of the disk, for so long [s].
  FaultStorm(fci::SimulatedRun& run, InstanceSet work, std::uint64_t seed, double mean_interval_s,
             std::function<void(Fault, double)> disk);

  void step();    // once per cycle, after it
  void finish();  // no further fault; releases what is pressed

  // Arms that a fault has reached, until they are in torque control again and a second has passed.
  ArmSet disturbed() const { return disturbed_; }
  const std::vector<InjectedFault>& injected() const { return injected_; }
  std::uint64_t requests() const { return requests_; }  // of the storms
  std::uint64_t recoveries() const { return recoveries_; }

 private:
  struct Planned {
    double at_s = 0;
    std::function<void()> what;
  };
  struct Arm {
    double calm_from_s = 0;      // undisturbed from then on, if it takes commands
    double repair_at_s = -1;     // when the user recovers or reconnects it; -1: nothing to repair
    bool held_by_fault = false;  // its button is pressed, or its cable pulled
    std::future<RequestAnswer> repair;
  };
  void inject();
  void inject(Fault fault, ArmIndex arm);
  void disturb(ArmIndex arm, double for_s);
  void disturb_group(ArmIndex arm, double for_s);
  void after(double delay_s, std::function<void()> what);
  void repair_arm(ArmIndex arm);
  void return_to_work();
  void post(const Request& request);
  void request_switch();
  void set_parameter();
  void set_goal();

  fci::SimulatedRun& run_;
  InstanceSet work_;
  fci::Draw draw_;
  double mean_interval_s_, next_s_, next_return_s_ = 2;
  std::function<void(Fault, double)> disk_;
  std::vector<Planned> planned_;
  std::deque<Arm> arms_;
  ArmSet disturbed_;
  std::vector<InjectedFault> injected_;
  std::uint64_t requests_ = 0, recoveries_ = 0;
  std::vector<std::vector<std::vector<double>>> centers_;  // of goals, by instance and input; empty: none yet
};

}  // namespace multipanda
