#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "logs/event_text.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/recorder.hpp"

namespace multipanda {

msg::Time to_time(std::int64_t ns);

// Turns cycle records and events into messages and passes them to a writer. One thread.
class Recorder::Sink {
 public:
  Sink(const std::filesystem::path& log, const RecordLayout& layout, std::vector<RecordedArm> arms,
       RecorderOptions options);

  void write(const CycleRecord& record);
  void write(const Event& event);
  void write(const EpisodeMark& mark);
  void write(const ObjectRing::Row& objects);
  void write_missing(const RecorderStatus& status);  // the metadata record "missing"

  McapWriter& writer() { return writer_; }
  std::uint64_t cycles() const { return cycles_; }

 private:
  struct Arm {
    std::string name;
    std::size_t joint_count = 0;
    std::optional<ModelTerms> terms;
    std::optional<BaseMount> mount;  // none without the terms of its carrier
    ArmFrames frames;
    Load tool, load;
    bool configured = false;  // an ArmConfig has been written
    std::uint16_t state_channel = 0, command_channel = 0, model_channel = 0, wrench_channel = 0,
                  report_channel = 0, config_channel = 0;
    msg::ArmState state;
    msg::ArmCommand command;
    msg::ModelSummary model;
    msg::ArmWrench wrench;
    msg::ArmReport report;
  };

  void describe(const RecorderOptions& options);
  void note_gap(const CycleRecord& record);
  void write_arm(Arm& arm, const ArmSample& sample, const CycleRecord& record);
  void write_command(Arm& arm, const ArmSample& sample, const CycleRecord& record);
  void write_wrench(Arm& arm, const ArmSample& sample, const CycleRecord& record);
  void update_models(const CycleRecord& record);
  void write_model(Arm& arm, const CycleRecord& record);
  void write_references(const CycleRecord& record);
  void write_outputs(const CycleRecord& record);
  void write_timing(const CycleRecord& record);
  void write_config(Arm& arm, LoopTime t, std::uint64_t cycle);
  void write_switch(const Event& event);
  void write_intervention(const Event& event);
  void write_other(const Event& event);

  std::int64_t log_time(LoopTime t) const { return t.ns + options_.log_time_offset_ns; }

  RecordLayout layout_;
  EventText words_{layout_};
  RecorderOptions options_;
  McapWriter writer_;
  std::vector<Arm> arms_;
  std::vector<std::vector<std::uint16_t>> reference_channels_;  // by instance and input
  std::vector<std::uint16_t> output_channels_;                  // by instance
  std::vector<std::uint16_t> object_channels_;                  // by name
  std::uint16_t event_channel_ = 0, switch_channel_ = 0, switch_timing_channel_ = 0,
                intervention_channel_ = 0, timing_channel_ = 0;
  msg::ObjectPose object_;
  msg::Reference reference_;
  msg::ControlletOutputs outputs_;
  std::map<std::pair<std::uint16_t, Intervention>, std::uint64_t> intervention_counts_;  // by arm
  std::uint64_t cycles_ = 0, last_cycle_ = 0, cycles_lost_ = 0;
  HostTime first_start_;
};

}  // namespace multipanda
