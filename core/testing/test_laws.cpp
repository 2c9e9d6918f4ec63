#include "core/testing/test_laws.hpp"

#include <limits>
#include <stdexcept>

#include "core/controllets/builtins.hpp"
#include "core/features/builtins.hpp"

namespace multipanda::test {
namespace {

void spring(OwnedArm& arm, const JointVector& q_start, double seconds) {
  *arm.tau = 3 * (q_start - arm.q()) - 2 * arm.dq();
  arm.tau->array() += 0.01 * seconds;
}

class Spring : public Controllet {
 public:
  explicit Spring(ArmModels arms) : q_start_(arms.size()) {}
  LawResult start(ControlContext& context) override {
    for (std::size_t i = 0; i < q_start_.size(); ++i) q_start_[i] = context.arms[i].q();
    age_s_ = 0;
    return LawResult::ok;
  }
  LawResult update(ControlContext& context) override {
    age_s_ += context.dt;
    for (std::size_t i = 0; i < q_start_.size(); ++i) spring(context.arms[i], q_start_[i], age_s_);
    return LawResult::ok;
  }

 private:
  std::vector<JointVector> q_start_;
  double age_s_ = 0;
};

class Follow final : public Controllet {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    *arm.tau = 20 * (context.inputs[0].joints() - arm.q()) - 2 * arm.dq();
    return LawResult::ok;
  }
};

class BrokenSpring final : public Spring {
 public:
  using Spring::Spring;
  LawResult update(ControlContext& context) override {
    (void)Spring::update(context);
    JointVector& tau = *context.arms[0].tau;
    switch (context.parameters->choice(0)) {
      case 1:
        tau[2] = std::numeric_limits<double>::quiet_NaN();
        break;
      case 2:
        tau[0] = -std::numeric_limits<double>::infinity();
        break;
      case 3:
        tau[1] = 1e6;
        break;
      case 4:
        throw std::runtime_error("thrown by a test");
      case 5:
        return LawResult::fault;
      case 6:
        tau.resize(2);
        break;
      default:
        break;
    }
    return LawResult::ok;
  }
};

class Refuser final : public Controllet {
 public:
  LawResult start(ControlContext&) override { return LawResult::fault; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
};

class Thrower final : public Controllet {
 public:
  LawResult start(ControlContext&) override { throw std::runtime_error("no"); }
  LawResult update(ControlContext&) override { return LawResult::ok; }
};

class Push final : public Feature {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    const double push = context.parameters->number(0);
    if (push < -98) throw std::runtime_error("thrown by a test");
    for (auto& arm : context.arms) {
      arm.tau->array() += push > 98 ? std::numeric_limits<double>::quiet_NaN() : push;
    }
    context.outputs[0] = push;
    return LawResult::ok;
  }
};

template <typename Law>
std::unique_ptr<Controllet> make(ArmModels) {
  return std::make_unique<Law>();
}
template <typename Law>
std::unique_ptr<Controllet> make_for(ArmModels arms) {
  return std::make_unique<Law>(arms);
}

}  // namespace

Registry test_registry() {
  Registry registry;
  registry.add(hold_controllet());
  registry.add(gravity_compensation_controllet());
  registry.add(joint_limits_feature());
  registry.add(ControlletType{{.type = "spring", .doc = "", .arms = 1}, make_for<Spring>});
  registry.add(ControlletType{{.type = "pair", .doc = "", .arms = 2}, make_for<Spring>});
  registry.add(ControlletType{
      {.type = "follow", .doc = "", .arms = 1, .inputs = {{.name = "joints", .quantity = Quantity::joints}}},
      make<Follow>});
  registry.add(
      ControlletType{{.type = "broken",
                      .doc = "",
                      .arms = 1,
                      .parameters = {{"fault",
                                      "",
                                      1,
                                      {0},
                                      0,
                                      6,
                                      "",
                                      {"no", "nan", "infinite", "implausible", "throw", "report", "size"}}}},
                     make_for<BrokenSpring>});
  registry.add(ControlletType{{.type = "refuser", .doc = "", .arms = 1}, make<Refuser>});
  registry.add(ControlletType{{.type = "thrower", .doc = "", .arms = 1}, make<Thrower>});
  registry.add(FeatureType{
      {.type = "push",
       .doc = "",
       .parameters = {{"torque_nm", "N m", 1, {0.5}, -100, 100, ""}},
       .outputs = {{"push_nm", 1, ""}}},
      [](const FeatureContext&) -> std::unique_ptr<Feature> { return std::make_unique<Push>(); }});
  return registry;
}

}  // namespace multipanda::test
