#include "core/testing/test_world.hpp"

#include <Eigen/Cholesky>

#include "core/types/time.hpp"

namespace multipanda::test {

TestWorld::TestWorld(const std::vector<std::shared_ptr<const ArmModel>>& models, bool feels) : feels_(feels) {
  for (const auto& model : models) {
    const JointVector zero = joint_constant(model->joint_count(), 0);
    arms_.push_back({ModelTerms(model), model->q_home(), zero, zero});
  }
}

ArmSet TestWorld::wait() {
  now_ = LoopTime::from_seconds(start_s + static_cast<double>(step_) * step_s);
  const ArmSet due = due_in_step ? due_in_step(step_) : ArmSet::all(arms_.size());
  return due;
}

void TestWorld::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!due.contains(i)) continue;
    Arm& arm = arms_[i];
    ArmState& state = states[i];
    state.sequence = ++arm.sequence;
    state.t_robot = {static_cast<std::int64_t>(arm.sequence) * 1'000'000};
    state.t_host = host_now();
    state.q = arm.q;
    state.dq = arm.dq;
    arm.terms.update(arm.q, arm.dq);
    state.tau_J = arm.tau + arm.terms.g();
    state.tau_J_d = arm.tau;
    state.mode = ArmMode::move;
    if (tamper) tamper(i, step_, state);
  }
}

// Semi-implicit Euler: the new velocity moves the arm.
void TestWorld::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!due.contains(i)) continue;
    Arm& arm = arms_[i];
    arm.tau = commands[i].tau_cmd;
    arm.terms.update(arm.q, arm.dq);
    const JointVector rest = arm.tau - arm.terms.c();
    const Eigen::LLT<JointMatrix> cholesky(arm.terms.M());
    const JointVector ddq = cholesky.solve(rest);
    arm.dq += kArmPeriod * ddq;
    arm.q += kArmPeriod * arm.dq;
  }
  ++step_;
}

std::future<RequestAnswer> TestWorld::request(ArmIndex, ArmRequest) {
  return refuse_request("the test world does not support requests");
}

std::vector<std::shared_ptr<const ArmModel>> test_models(std::size_t arms, std::size_t joints) {
  std::vector<std::shared_ptr<const ArmModel>> models;
  for (std::size_t i = 0; i < arms; ++i) {
    const auto k = static_cast<double>(i);
    const Pose X_WB{rotation_from_rpy({0.2 * k, -0.1 * k, 0.7 * k}), Vector3(0.1 * k, 0.6 * k, 0.05 * k)};
    auto source = TestArm::make(joints).source(X_WB, "arm" + std::to_string(i));
    source.known_friction = JointFrictionTable{joint_constant(joints, 0.5), joint_constant(joints, 10),
                                               joint_constant(joints, 0)};
    models.push_back(std::make_shared<const ArmModel>(std::move(source)));
  }
  return models;
}

CycleConfig test_config(const std::vector<std::shared_ptr<const ArmModel>>& models,
                        std::vector<InstanceConfig> controllets, std::size_t record_capacity) {
  CycleConfig config;
  for (const auto& model : models) config.arms.push_back({model->name(), model, SafetyLimits::of(*model)});
  config.controllets = std::move(controllets);
  config.record_capacity = record_capacity;
  return config;
}

TestLoop::TestLoop(std::size_t arms, std::vector<InstanceConfig> controllets, const Registry& registry,
                   std::size_t record_capacity)
    : models(test_models(arms)),
      world(models),
      cycle(test_config(models, std::move(controllets), record_capacity), registry, world) {}

TestLoop::TestLoop(std::vector<std::shared_ptr<const ArmModel>> arms, CycleConfig config,
                   const Registry& registry, bool feels)
    : models(std::move(arms)), world(models, feels), cycle(std::move(config), registry, world) {}

InstanceSet TestLoop::set(std::initializer_list<std::string_view> names) {
  InstanceSet set = 0;
  for (const auto name : names) {
    const InstanceIndex i = find(name);
    if (i == kNoInstance) throw std::invalid_argument("no instance " + std::string(name));
    set |= bit(i);
  }
  return set;
}

Answer TestLoop::ask(const Request& request) {
  Answer answer;
  std::uint64_t ticket = 0;
  answer.verdict = modes().post(std::span(&request, 1), ticket);
  step();
  if (answer.accepted() && !modes().poll(ticket, answer)) answer.verdict = Verdict::timeout;
  return answer;
}

std::string TestLoop::ownership_fault() {
  ArmSet owned;
  for (InstanceIndex i = 0; i < modes().instance_count(); ++i) {
    if ((modes().active() & bit(i)) == 0) continue;
    const ArmSet arms = modes().instance(i).arms();
    if (owned.overlaps(arms)) return modes().instance(i).name() + " owns an arm that another one owns";
    owned |= arms;
  }
  if (owned != ArmSet::all(models.size())) return "an arm has no owner";
  for (ArmIndex arm = 0; arm < models.size(); ++arm) {
    const InstanceIndex owner = modes().owner(arm);
    if ((modes().active() & bit(owner)) == 0) return "the owner of an arm is not active";
    if (!modes().instance(owner).arms().contains(arm)) return "the owner of an arm does not list it";
  }
  return {};
}

}  // namespace multipanda::test
