#include "experiments/run_data.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "logs/npz.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

// Columns of an arm in this order, followed by those of its model.
enum State : std::size_t {
  kStateTime,
  kStateCycle,
  kQ,
  kDq,
  kTauJ,
  kTauJd,
  kCommandTime,
  kTauControllet,
  kTauFeature,
  kTauCmd,
  kLimited,
  kWrenchTime,
  kHasEstimate,
  kHasTruth,
  kEstimatedForce,
  kEstimatedTorque,
  kContactForce,
  kContactTorque
};
enum Model : std::size_t { kModelTime, kModelCycle, kPosition, kOrientation, kLinear, kGravity };
enum InputColumn : std::size_t { kInputTime, kInputCycle, kValue, kRate };

// Columns that no figure uses: parts of the power balance.
bool used_in_figures(const std::string& output) { return !output.starts_with("power_"); }

}  // namespace

RunData::RunData(const Scene& scene, const RecordLayout& layout,
                 const std::vector<std::shared_ptr<const ArmModel>>& models, std::uint64_t model_every)
    : model_every_(model_every), layout_(layout) {
  for (std::size_t i = 0; i < layout.arms.size(); ++i) {
    const std::string& arm = layout.arms[i].name;
    const std::size_t n = layout.arms[i].joint_count;
    Arm entry{.joints = n, .first = columns_.size(), .first_model = 0, .terms = ModelTerms(models[i])};
    column(arm + "/state/t", 1, false);
    column(arm + "/state/cycle", 1, false);
    for (const char* name : {"q", "dq", "tau_j", "tau_j_d"}) column(arm + "/state/" + name, n, true);
    column(arm + "/command/t", 1, false);
    for (const char* name : {"tau_controllet", "tau_feature", "tau_cmd", "limited"})
      column(arm + "/command/" + name, n, true);
    column(arm + "/wrench/t", 1, false);
    column(arm + "/wrench/has_estimate", 1, false);
    column(arm + "/wrench/has_contact_truth", 1, false);
    for (const char* name : {"estimated_force", "estimated_torque", "contact_force", "contact_torque"})
      column(arm + "/wrench/" + name, 3, true);
    entry.first_model = columns_.size();
    column(arm + "/model/t", 1, false);
    column(arm + "/model/cycle", 1, false);
    column(arm + "/model/pose_position", 3, true);
    column(arm + "/model/pose_orientation", 4, true);
    column(arm + "/model/twist_linear", 3, true);
    column(arm + "/model/tau_gravity", n, true);
    owners_.push_back({.name = arm + "/command/owner", .values = {}});
    const ArmConfig config = arm_config(scene.arms.at(i));
    entry.terms.set_config(config.frames, config.tool, config.load);
    arms_.push_back(std::move(entry));
  }
  for (const auto& instance : layout.instances) {
    auto& inputs = inputs_.emplace_back();
    for (const auto& input : instance.inputs) {
      inputs.push_back(
          {.topic = instance.name + "/" + input.name, .kind = input.quantity, .frame = input.frame});
    }
    for (const auto& output : instance.outputs) {
      if (!used_in_figures(output.name)) continue;
      const std::string topic = instance.name + "/outputs/" + output.name;
      outputs_.push_back({.first = columns_.size(), .offset = output.offset, .size = output.size});
      column(topic + "/t", 1, false);
      column(topic + "/values", output.size, true);
    }
  }
}

std::size_t RunData::column(const std::string& name, std::size_t width, bool matrix) {
  columns_.push_back({.name = name, .width = width, .matrix = matrix, .values = {}});
  return columns_.size() - 1;
}

void RunData::put(std::size_t index, const double* values, std::size_t count) {
  auto& to = columns_[index].values;
  to.insert(to.end(), values, values + count);
}

void RunData::take_arm(std::size_t index, const CycleRecord& record) {
  Arm& arm = arms_[index];
  const ArmSample& sample = record.arms[index];
  const std::size_t n = arm.joints, first = arm.first;
  const double t = record.t.seconds();
  put(first + kStateTime, t);
  put(first + kStateCycle, static_cast<double>(record.cycle));
  put(first + kQ, sample.q.data(), n);
  put(first + kDq, sample.dq.data(), n);
  put(first + kTauJ, sample.tau_J.data(), n);
  put(first + kTauJd, sample.tau_J_d.data(), n);
  put(first + kCommandTime, t);
  put(first + kTauControllet, sample.tau_controllet.data(), n);
  put(first + kTauFeature, sample.tau_feature.data(), n);
  put(first + kTauCmd, sample.tau_cmd.data(), n);
  for (std::size_t i = 0; i < n; ++i) {
    put(first + kLimited, sample.tau_cmd[i] != sample.tau_controllet[i] + sample.tau_feature[i] ? 1 : 0);
  }
  owners_[index].values.push_back(sample.owner);
  if (sample.has_wrench_estimate || sample.has_contact_truth) {
    put(first + kWrenchTime, t);
    put(first + kHasEstimate, sample.has_wrench_estimate ? 1 : 0);
    put(first + kHasTruth, sample.has_contact_truth ? 1 : 0);
    put(first + kEstimatedForce, sample.F_K_W_est.data(), 3);
    put(first + kEstimatedTorque, sample.F_K_W_est.data() + 3, 3);
    put(first + kContactForce, sample.F_K_W_true.data(), 3);
    put(first + kContactTorque, sample.F_K_W_true.data() + 3, 3);
  }
  if ((record.cycle - 1) % model_every_ != 0) return;
  const auto size = static_cast<Eigen::Index>(n);
  arm.terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), size)),
                   JointVector(Eigen::Map<const Eigen::VectorXd>(sample.dq.data(), size)));
  const Pose X_WE = arm.terms.X_WE();
  const Quaternion q = X_WE.quaternion();
  const std::array<double, 4> xyzw{q.x(), q.y(), q.z(), q.w()};
  const Vector6 V_WE = arm.terms.V_WE().vector;
  put(arm.first_model + kModelTime, t);
  put(arm.first_model + kModelCycle, static_cast<double>(record.cycle));
  put(arm.first_model + kPosition, X_WE.position.data(), 3);
  put(arm.first_model + kOrientation, xyzw.data(), 4);
  put(arm.first_model + kLinear, V_WE.data(), 3);
  put(arm.first_model + kGravity, arm.terms.g().data(), n);
}

void RunData::take(const CycleRecord& record) {
  for (std::size_t i = 0; i < arms_.size(); ++i) take_arm(i, record);
  for (std::size_t i = 0; i < record.reference_count; ++i) {
    const ReferenceSample& sample = record.references[i];
    Series& input = inputs_.at(sample.instance).at(sample.input);
    const std::size_t rates = input.kind == "pose" ? 6 : sample.size;
    if (!input.seen) {
      input.seen = true;
      input.first = column(input.topic + "/t", 1, false);
      column(input.topic + "/cycle", 1, false);
      column(input.topic + "/value", sample.size, true);
      column(input.topic + "/rate", rates, true);
    }
    put(input.first + kInputTime, record.t.seconds());
    put(input.first + kInputCycle, static_cast<double>(record.cycle));
    put(input.first + kValue, sample.values.data(), sample.size);
    put(input.first + kRate, sample.rates.data(), rates);
  }
  for (const auto& output : outputs_) {
    const double* values = record.outputs.data() + output.offset;
    if (std::all_of(values, values + output.size, [](double value) { return std::isnan(value); })) continue;
    put(output.first, record.t.seconds());
    put(output.first + 1, values, output.size);
  }
}

void RunData::write(const std::filesystem::path& file) const {
  std::vector<NpzWriter::Array> arrays;
  std::vector<const Numbers*> filled;  // a log also lacks outputs of controllets that never ran
  for (const auto& column : columns_) {
    if (!column.values.empty()) filled.push_back(&column);
  }
  for (const auto* numbers : filled) {
    const Numbers& column = *numbers;
    arrays.push_back({column.name, NpzWriter::Kind::real, column.values.size() / column.width, column.width,
                      column.matrix});
  }
  std::size_t longest = 1;
  for (const auto& instance : layout_.instances) longest = std::max(longest, code_point_count(instance.name));
  for (const auto& owner : owners_)
    arrays.push_back({owner.name, NpzWriter::Kind::text, owner.values.size(), longest, false});
  std::vector<std::pair<std::size_t, const Series*>> kinds;  // one row for all cycles
  for (const auto& instance : inputs_) {
    for (const auto& input : instance) {
      if (!input.seen) continue;
      kinds.emplace_back(arrays.size(), &input);
      arrays.push_back(
          {input.topic + "/kind", NpzWriter::Kind::text, 1, code_point_count(input.kind), false});
      arrays.push_back({input.topic + "/frame", NpzWriter::Kind::text, 1,
                        std::max<std::size_t>(1, code_point_count(input.frame)), false});
    }
  }
  NpzWriter writer(file, std::move(arrays));
  std::vector<double> row;
  for (std::size_t i = 0; i < filled.size(); ++i) {
    const auto& [name, width, matrix, values] = *filled[i];
    for (std::size_t at = 0; at + width <= values.size(); at += width) {
      row.assign(values.begin() + static_cast<std::ptrdiff_t>(at),
                 values.begin() + static_cast<std::ptrdiff_t>(at + width));
      writer.add(i, row);
    }
  }
  for (std::size_t i = 0; i < owners_.size(); ++i) {
    for (const std::uint16_t owner : owners_[i].values) {
      writer.add(filled.size() + i,
                 owner < layout_.instances.size() ? std::string_view(layout_.instances[owner].name) : "");
    }
  }
  for (const auto& [index, input] : kinds) {
    writer.add(index, std::string_view(input->kind));
    writer.add(index + 1, std::string_view(input->frame));
  }
  writer.close();
}

}  // namespace multipanda
