#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/rt/pacer.hpp"

namespace multipanda {

// Replays a log: delivers the recorded states of every arm, cycle by cycle, and compares commands with the
// recorded ones. A controller with the same initial state gives the same commands.
//
// The whole log is read before the start (about 0.4 kB per arm and cycle). Requests are refused: a recording
// cannot be changed.
class ReplayBackend : public Backend {
 public:
  // One of the recorded arms; frames, tool and load as at the start of the run, later ones come from the log.
  // (From the scene and not from the log's first ArmConfig: converting a quaternion does not preserve every
  // bit.)
  struct Arm {
    std::string name;
    ArmFrames frames;
    Load tool, load;
  };

  // Arms in the order of the scene. `paced`: at 1 kHz instead of as fast as possible.
  // Throws std::runtime_error when the log cannot be read or has no states of one of the arms.
  // `report` gets the result of the comparison after the run.
  ReplayBackend(const std::filesystem::path& log, std::vector<Arm> arms, bool paced = false,
                std::function<void(const std::string&)> report = {});

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override { pacer_.start(); }
  void finish() override;
  ArmSet wait() override;  // empty at the recording's end
  LoopTime now() const override { return cycles_[position_].t; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;

  // Cycles of the recording with both a state and a command of every arm.
  std::size_t cycle_count() const { return cycles_.size(); }
  // Largest difference between commanded and recorded joint torque so far [N m]; 0: identical bits.
  double largest_difference() const { return largest_difference_; }
  std::size_t compared() const { return compared_; }  // commands compared so far

 private:
  struct Cycle {
    LoopTime t;
    ArmSet due;
    std::vector<ArmState> states;
    std::vector<JointVector> commands;
  };
  std::vector<Arm> arms_;
  std::vector<Cycle> cycles_;
  std::size_t position_ = 0;
  bool begun_ = false;
  bool paced_;
  std::function<void(const std::string&)> report_;
  Pacer pacer_;
  double largest_difference_ = 0;
  std::size_t compared_ = 0;
};

}  // namespace multipanda
