#include "logs/record_messages.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include "logs/arm_state_fields.hpp"

namespace multipanda {
namespace {

void set(msg::Vector3& out, const auto& v) { out.x = v[0], out.y = v[1], out.z = v[2]; }

msg::Pose to_message(const Pose& X) {
  msg::Pose out;
  out.position.x = X.position.x();
  out.position.y = X.position.y();
  out.position.z = X.position.z();
  const Quaternion q = X.quaternion();
  out.orientation.x = q.x();
  out.orientation.y = q.y();
  out.orientation.z = q.z();
  out.orientation.w = q.w();
  return out;
}

// By cycle number, not by count: the same cycles in every run, even if records are lost.
bool is_due(std::uint64_t every, const CycleRecord& record) {
  return every > 0 && (record.cycle - 1) % every == 0;
}

double as_seconds(std::int32_t ns) { return 1e-9 * ns; }

std::string layout_json(const RecordLayout& layout) {
  nlohmann::ordered_json out;
  for (const auto& arm : layout.arms)
    out["arms"].push_back({{"name", arm.name}, {"joints", arm.joint_count}});
  for (const auto& instance : layout.instances) {
    nlohmann::ordered_json entry{{"name", instance.name}, {"type", instance.type}};
    entry["arms"] = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < layout.arms.size(); ++i) {
      if ((instance.arms >> i & 1u) != 0) entry["arms"].push_back(layout.arms[i].name);
    }
    entry["inputs"] = nlohmann::ordered_json::array();
    for (const auto& input : instance.inputs) {
      entry["inputs"].push_back({{"name", input.name}, {"quantity", input.quantity}, {"frame", input.frame}});
    }
    entry["parameters"] = instance.parameters;
    entry["features"] = instance.features;
    entry["outputs"] = nlohmann::ordered_json::array();
    for (const auto& output : instance.outputs) {
      entry["outputs"].push_back({{"name", output.name}, {"size", output.size}});
    }
    out["instances"].push_back(entry);
  }
  return out.dump(1);
}

}  // namespace

msg::Time to_time(std::int64_t ns) {
  constexpr std::int64_t kSecond = 1'000'000'000;
  const std::int64_t rest = (ns % kSecond + kSecond) % kSecond;
  msg::Time time;
  time.sec = static_cast<std::int32_t>((ns - rest) / kSecond);
  time.nanosec = static_cast<std::uint32_t>(rest);
  return time;
}

Recorder::Sink::Sink(const std::filesystem::path& log, const RecordLayout& layout,
                     std::vector<RecordedArm> arms, RecorderOptions options)
    : layout_(layout), options_(std::move(options)), writer_(log, options_.writer) {
  if (arms.size() != layout.arms.size()) {
    throw std::invalid_argument("recorder: " + std::to_string(arms.size()) + " arms given, the layout has " +
                                std::to_string(layout.arms.size()));
  }
  describe(options_);
  for (std::size_t i = 0; i < arms.size(); ++i) {
    Arm arm;
    arm.name = layout.arms[i].name;
    arm.joint_count = layout.arms[i].joint_count;
    arm.frames = arms[i].frames;
    arm.tool = arms[i].tool;
    arm.load = arms[i].load;
    const std::string topic = "/" + arm.name;
    arm.state_channel = writer_.add_channel<msg::ArmState>(topic + "/state");
    arm.command_channel = writer_.add_channel<msg::ArmCommand>(topic + "/command");
    arm.wrench_channel = writer_.add_channel<msg::ArmWrench>(topic + "/wrench");
    arm.report_channel = writer_.add_channel<msg::ArmReport>(topic + "/report");
    arm.config_channel = writer_.add_channel<msg::ArmConfig>(topic + "/config");
    if (arms[i].model && options_.every.model > 0) {
      arm.model_channel = writer_.add_channel<msg::ModelSummary>(topic + "/model");
      arm.terms.emplace(arms[i].model);
    }
    arm.state.arm = arm.command.arm = arm.model.arm = arm.wrench.arm = arm.report.arm = arm.name;
    arms_.push_back(std::move(arm));
  }
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    if (!arms_[i].terms || !arms[i].mount || !arms_.at(arms[i].mount->carrier).terms) continue;
    arms_[i].mount = arms[i].mount;
    arms_[arms[i].mount->carrier].terms->carry(*arms_[i].terms, arms[i].mount->joint);
  }
  for (const auto& instance : layout.instances) {
    auto& inputs = reference_channels_.emplace_back();
    for (const auto& input : instance.inputs) {
      inputs.push_back(writer_.add_channel<msg::Reference>("/" + instance.name + "/" + input.name));
    }
    output_channels_.push_back(instance.outputs.empty() ? std::uint16_t{0}
                                                        : writer_.add_channel<msg::ControlletOutputs>(
                                                              "/" + instance.name + "/outputs"));
  }
  if (options_.objects != nullptr) {
    for (const auto& name : options_.objects->names())
      object_channels_.push_back(writer_.add_channel<msg::ObjectPose>("/objects/" + name));
  }
  event_channel_ = writer_.add_channel<msg::Event>("/events");
  switch_channel_ = writer_.add_channel<msg::Switch>("/switches");
  switch_timing_channel_ = writer_.add_channel<msg::SwitchTiming>("/switch_timing");
  intervention_channel_ = writer_.add_channel<msg::Intervention>("/interventions");
  timing_channel_ = writer_.add_channel<msg::CycleTiming>("/timing");
}

void Recorder::Sink::describe(const RecorderOptions& options) {
  writer_.add(mcap::Metadata{"run", options.info});
  for (const mcap::Attachment& attachment : options.attachments) writer_.add(attachment);
  writer_.add(mcap::Attachment{0, 0, "layout.json", "application/json", layout_json(layout_)});
}

void Recorder::Sink::write_missing(const RecorderStatus& status) {
  mcap::StringMap values{{"cycles", std::to_string(status.cycles)},
                         {"cycles_lost", std::to_string(status.cycles_lost)},
                         {"events_lost", std::to_string(status.events_lost)},
                         {"messages_written", std::to_string(status.writer.messages_written)},
                         {"messages_lost", std::to_string(status.writer.messages_lost)},
                         {"error", status.writer.error}};
  for (const auto& [topic, count] : status.writer.lost_by_topic)
    values["lost:" + topic] = std::to_string(count);
  writer_.add(mcap::Metadata{"missing", values});
}

void Recorder::Sink::write(const CycleRecord& record) {
  note_gap(record);
  for (Arm& arm : arms_) {
    if (cycles_ == 0 && !arm.configured) write_config(arm, record.t, record.cycle);
  }
  if (is_due(options_.every.model, record)) update_models(record);
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    write_arm(arms_[i], record.arms[i], record);
  }
  if (is_due(options_.every.references, record)) write_references(record);
  if (is_due(options_.every.outputs, record)) write_outputs(record);
  if (is_due(options_.every.timing, record)) write_timing(record);
  ++cycles_;
}

// The loop drops whole records; gaps in their numbers show where.
void Recorder::Sink::note_gap(const CycleRecord& record) {
  if (cycles_ == 0) {
    first_start_ = record.start;
  } else if (record.cycle != last_cycle_ + 1) {
    const std::uint64_t lost = record.cycle - last_cycle_ - 1;
    cycles_lost_ += lost;
    msg::Event event;
    event.stamp = to_time(record.t.ns);
    event.cycle = record.cycle;
    event.kind = "records_lost";
    event.text = std::to_string(lost) + " cycles before this one are missing; the writer fell behind";
    event.values = {static_cast<double>(last_cycle_ + 1), static_cast<double>(record.cycle - 1)};
    writer_.write(event_channel_, log_time(record.t), event);
  }
  last_cycle_ = record.cycle;
}

void Recorder::Sink::write_arm(Arm& arm, const ArmSample& sample, const CycleRecord& record) {
  if (is_due(options_.every.state, record)) {
    msg::ArmState& state = arm.state;
    state.stamp = to_time(record.t.ns);
    state.cycle = record.cycle;
    set_measured(state, sample, arm.joint_count);
    writer_.write(arm.state_channel, log_time(record.t), state);
  }
  if (is_due(options_.every.command, record)) write_command(arm, sample, record);
  const bool has_wrench = sample.has_wrench_estimate || sample.has_contact_truth;
  if (has_wrench && is_due(options_.every.wrench, record)) write_wrench(arm, sample, record);
  if (sample.has_report && is_due(options_.every.report, record)) {
    arm.report.stamp = to_time(record.t.ns);
    arm.report.cycle = record.cycle;
    set_measured(arm.report, sample, arm.joint_count);
    writer_.write(arm.report_channel, log_time(record.t), arm.report);
  }
  if (arm.terms && is_due(options_.every.model, record)) write_model(arm, record);
}

void Recorder::Sink::write_command(Arm& arm, const ArmSample& sample, const CycleRecord& record) {
  const std::size_t n = arm.joint_count;
  msg::ArmCommand& command = arm.command;
  command.stamp = to_time(record.t.ns);
  command.cycle = record.cycle;
  command.owner = words_.instance_name(sample.owner);
  set_commanded(command, sample, n);
  command.limited.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    command.limited[i] = sample.tau_cmd[i] != sample.tau_controllet[i] + sample.tau_feature[i];
  }
  writer_.write(arm.command_channel, log_time(record.t), command);
}

void Recorder::Sink::write_wrench(Arm& arm, const ArmSample& sample, const CycleRecord& record) {
  msg::ArmWrench& wrench = arm.wrench;
  wrench.stamp = to_time(record.t.ns);
  wrench.cycle = record.cycle;
  wrench.has_estimate = sample.has_wrench_estimate;
  wrench.has_contact_truth = sample.has_contact_truth;
  set_field(wrench.estimated, sample.F_K_W_est, arm.joint_count, sample.has_wrench_estimate);
  set_measured(wrench, sample, arm.joint_count);
  writer_.write(arm.wrench_channel, log_time(record.t), wrench);
}

// All before the first is written: an arm and its carrier need each other's configuration.
void Recorder::Sink::update_models(const CycleRecord& record) {
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    if (!arms_[i].terms) continue;
    const auto n = static_cast<Eigen::Index>(arms_[i].joint_count);
    arms_[i].terms->update(JointVector(Eigen::Map<const Eigen::VectorXd>(record.arms[i].q.data(), n)),
                           JointVector(Eigen::Map<const Eigen::VectorXd>(record.arms[i].dq.data(), n)));
  }
  for (Arm& arm : arms_) {
    if (arm.mount) arm.terms->stand_on(*arms_[arm.mount->carrier].terms, *arm.mount);
  }
}

void Recorder::Sink::write_model(Arm& arm, const CycleRecord& record) {
  const auto n = static_cast<Eigen::Index>(arm.joint_count);
  ModelTerms& terms = *arm.terms;
  msg::ModelSummary& model = arm.model;
  model.stamp = to_time(record.t.ns);
  model.cycle = record.cycle;
  model.pose = to_message(terms.X_WE());
  const Vector6 V_WE = terms.V_WE().vector;
  set(model.twist.linear, V_WE.data());
  set(model.twist.angular, V_WE.data() + 3);
  model.tau_gravity.assign(terms.g().data(), terms.g().data() + n);
  model.tau_coriolis.assign(terms.c().data(), terms.c().data() + n);
  model.manipulability = terms.manipulability();
  writer_.write(arm.model_channel, log_time(record.t), model);
}

void Recorder::Sink::write(const ObjectRing::Row& objects) {
  object_.stamp = to_time(objects.t.ns);
  object_.cycle = objects.cycle;
  for (std::size_t i = 0; i < object_channels_.size(); ++i) {
    if (!objects.X_WO[i]) continue;
    object_.object = options_.objects->names()[i];
    object_.pose = to_message(*objects.X_WO[i]);
    writer_.write(object_channels_[i], log_time(objects.t), object_);
  }
}

void Recorder::Sink::write_references(const CycleRecord& record) {
  reference_.stamp = to_time(record.t.ns);
  reference_.cycle = record.cycle;
  for (std::size_t i = 0; i < record.reference_count; ++i) {
    const ReferenceSample& sample = record.references[i];
    const auto& instance = layout_.instances.at(sample.instance);
    const auto& input = instance.inputs.at(sample.input);
    reference_.instance = instance.name;
    reference_.input = input.name;
    reference_.kind = input.quantity;
    reference_.frame = input.frame;
    reference_.streaming = sample.streaming;
    reference_.value.assign(sample.values.begin(), sample.values.begin() + sample.size);
    const int rates = input.quantity == "pose" ? 6 : sample.size;  // seven numbers, but six velocities
    reference_.rate.assign(sample.rates.begin(), sample.rates.begin() + rates);
    writer_.write(reference_channels_[sample.instance][sample.input], log_time(record.t), reference_);
  }
}

// One message of an instance, since each message costs 16 bytes of index. The numbers are rounded to those of
// a float: the digits behind them take most of the space and mean nothing.
void Recorder::Sink::write_outputs(const CycleRecord& record) {
  outputs_.stamp = to_time(record.t.ns);
  outputs_.cycle = record.cycle;
  for (std::size_t i = 0; i < layout_.instances.size(); ++i) {
    const auto& instance = layout_.instances[i];
    std::size_t count = 0;
    outputs_.outputs.resize(instance.outputs.size());
    for (const auto& output : instance.outputs) {
      const auto numbers = std::span(record.outputs).subspan(output.offset, output.size);
      if (std::ranges::all_of(numbers, [](double value) { return std::isnan(value); }))
        continue;  // not active
      msg::OutputValues& out = outputs_.outputs[count++];
      out.name = output.name;
      out.values.resize(numbers.size());
      std::ranges::transform(numbers, out.values.begin(),
                             [](double value) { return static_cast<double>(static_cast<float>(value)); });
    }
    if (count == 0) continue;
    outputs_.outputs.resize(count);
    outputs_.instance = instance.name;
    writer_.write(output_channels_[i], log_time(record.t), outputs_);
  }
}

void Recorder::Sink::write_timing(const CycleRecord& record) {
  msg::CycleTiming timing;
  timing.stamp = to_time(record.t.ns);
  timing.cycle = record.cycle;
  timing.start = seconds(record.start - first_start_);
  timing.period = record.period_s;
  timing.overruns = record.overruns;
  timing.read = as_seconds(record.stages.read);
  timing.controllets = as_seconds(record.stages.controllets);
  timing.features = as_seconds(record.stages.features);
  timing.safety = as_seconds(record.stages.safety);
  timing.write = as_seconds(record.stages.write);
  timing.total = as_seconds(record.stages.total);
  timing.records_lost = cycles_lost_;
  writer_.write(timing_channel_, log_time(record.t), timing);
}

void Recorder::Sink::write_config(Arm& arm, LoopTime t, std::uint64_t cycle) {
  arm.configured = true;
  if (arm.terms) arm.terms->set_config(arm.frames, arm.tool, arm.load);
  const auto inertia = [](const Matrix3& I) {
    return std::array<double, 6>{I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
  };
  const auto point = [](const Vector3& p) {
    msg::Point out;
    out.x = p.x(), out.y = p.y(), out.z = p.z();
    return out;
  };
  msg::ArmConfig config;
  config.stamp = to_time(t.ns);
  config.cycle = cycle;
  config.arm = arm.name;
  config.end_effector = to_message(arm.frames.X_FE);
  config.stiffness = to_message(arm.frames.X_EK);
  config.tool_mass = arm.tool.mass;
  config.tool_center = point(arm.tool.p_FC);
  config.tool_inertia = inertia(arm.tool.inertia_C);
  config.load_mass = arm.load.mass;
  config.load_center = point(arm.load.p_FC);
  config.load_inertia = inertia(arm.load.inertia_C);
  writer_.write(arm.config_channel, log_time(t), config);
}

}  // namespace multipanda
