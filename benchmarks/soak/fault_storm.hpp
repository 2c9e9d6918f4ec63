#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/arm_set.hpp"
#include "fci/simulated_time/simulated_run.hpp"
#include "fci/simulated_time/timing.hpp"
#include "logs/recorder.hpp"

namespace multipanda {

// Faults that an endurance run injects into arms, program and disk.
enum class Fault : std::uint8_t {
  reflex,        // the arm finds an error
  cable,         // the connection between arm and program is cut
  user_stop,     // the button is pressed and released
  push,          // a force of up to 30 N on the flange
  lost_answers,  // 1 to 19 in a row
  late_answers,  // 1 to 19 in a row
  lost_states,   // 1 to 19 in a row
  client_stall,  // the program stalls for 1 to 50 ms
  client_lost,   // the program disconnects, and another one connects
  switches,      // bursts of requests for other owners
  parameters,    // bursts of new values
  goals,         // bursts of goals
  full_disk,     // the log cannot grow
  slow_disk,     // nothing takes the log's records
  count_
};

std::string_view name_of(Fault fault);

// An injected fault.
struct InjectedFault {
  double at_s = 0;
  Fault fault = Fault::reflex;
  ArmSet arms;  // arms that it may stop or disturb
};

// Injects faults into a run, in sequence or several at once, all drawn from a seed, and acts like a user
// afterwards: releases, reconnects, recovers, switches back. Calls belong to the run's thread.
class FaultStorm {
 public:
  // `mean_interval_s`: mean time between two faults. `disk`: injects a disk fault of this duration [s].
  FaultStorm(fci::SimulatedRun& run, InstanceSet work, std::uint64_t seed, double mean_interval_s,
             std::function<void(Fault, double)> disk);

  void step();    // once per cycle, after it
  void finish();  // stops injecting; releases pressed buttons

  // Arms affected by a fault, until one second after they are back in torque control.
  ArmSet disturbed() const { return disturbed_; }
  const std::vector<InjectedFault>& injected() const { return injected_; }
  std::uint64_t requests() const { return requests_; }  // of the request bursts
  std::uint64_t recoveries() const { return recoveries_; }

 private:
  struct Planned {
    double at_s = 0;
    std::function<void()> what;
  };
  struct Arm {
    double calm_from_s = 0;      // undisturbed from then on if it accepts commands
    double repair_at_s = -1;     // time when the user recovers or reconnects it; -1: nothing to repair
    bool held_by_fault = false;  // its user stop is pressed, or its cable unplugged
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

// A log that is written while the disk is full or the writer stalls. The loop must not be affected: every
// record is either taken or counted as lost.
class DiskTrouble {
 public:
  // Files lie in `folder` and are removed again.
  DiskTrouble(std::filesystem::path folder, RecordLayout layout);
  ~DiskTrouble();
  DiskTrouble(const DiskTrouble&) = delete;

  // Begins a log unless one is being written.
  void begin(double at_s, bool full, double lasts_s);
  void take(const CycleRecord& cycle);  // after every cycle
  bool is_writing() const { return ring_ != nullptr; }
  // Reports faults of logs closed since the last call, such as records neither written nor counted.
  std::vector<std::string> take_findings() { return std::exchange(findings_, {}); }
  std::uint64_t written() const { return written_; }
  std::uint64_t lost() const { return lost_; }  // and counted

 private:
  void end();
  std::filesystem::path file_;
  RecordLayout layout_;
  std::unique_ptr<RecordRing> ring_;
  std::unique_ptr<Recorder> recorder_;
  bool full_ = false;
  double ends_s_ = 0;
  std::uint64_t cycles_ = 0, written_ = 0, lost_ = 0;
  std::vector<std::string> findings_;
};

}  // namespace multipanda
